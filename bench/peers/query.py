"""OpenCV and NumPy on the work of `hulltouch bench query`, on one thread.

Reads one JSON request a line from standard input and answers each with one line. `hulltouch bench query`
starts it and hands over the same masks and points that it asks itself; see docs/performance.md.

The steps are the paper's (sections 4 and 5) as one writes them with these libraries: projection by matrix
products, lookup by indexing, the nearest background pixel from a distance transform with labels, and
exits by marching all points at once, each step as long as the transform allows. The inside test goes in
blocks that fit the cache and drops rejected points camera by camera; a pass takes a frame's points at once
in all cameras, which was the fastest of the block sizes tried.
"""

import json
import sys
import time

try:
    import cv2
    import numpy as np
except ImportError as error:
    print(f"{error}: see bench/peers/requirements.txt", file=sys.stderr)
    sys.exit(1)

# Points of a block of the inside test; points whose windows are gathered at once.
INSIDE_BLOCK = 32_768
WINDOW_BLOCK = 1_024
# A march takes so many steps at most, and halves the one that left the silhouette so often.
MAX_STEPS = 4_096
HALVINGS = 4
# A transform is timed so often for a frame; it does not depend on the points.
TRANSFORMS = 3


class Camera:
    """One camera's matrices and mask."""

    def __init__(self, given, pad):
        self.width, self.height = given["width"], given["height"]
        self.matrix = np.array(given["matrix"]).reshape(3, 3)
        self.rotation = np.array(given["rotation"]).reshape(3, 3)
        self.translation = np.array(given["translation"])
        mask = np.fromfile(given["mask"], np.uint8).reshape(self.height, self.width)
        # A border of background: what lies off the image is clipped onto it, and windows stay within.
        self.padded = np.pad((mask != 0).astype(np.uint8), pad)


class Frame:
    """All cameras at one instant, padded, one after the other in one array."""

    def __init__(self, request):
        self.window, self.max_depth_m = request["window_pixels"], request["max_depth_m"]
        self.pad = self.window + 2
        cameras = [Camera(given, self.pad) for given in request["cameras"]]
        self.padded = [camera.padded for camera in cameras]
        self.count = len(cameras)
        self.rows, self.columns = self.padded[0].shape
        self.masks = np.concatenate([padded.ravel() for padded in self.padded])
        area = self.rows * self.columns
        self.bases = (np.arange(self.count, dtype=np.int32) * area)[:, None]
        self.matrices = np.stack([camera.matrix for camera in cameras])
        self.rotations = np.stack([camera.rotation for camera in cameras])
        self.translations = np.stack([camera.translation for camera in cameras])[:, :, None]
        # To columns and rows of the padded masks, times depth; a half rounds.
        shift = np.eye(3)
        shift[:2, 2] = self.pad + 0.5
        projections = shift @ self.matrices
        self.products = (projections @ self.rotations).reshape(-1, 3)
        self.offsets = (projections @ self.translations).reshape(-1, 1)
        # Metres that a pixel spans at a depth of one metre.
        self.spans = (1.0 / self.matrices[:, [0, 1], [0, 1]].max(axis=1))[:, None]
        self.whole = [(0, 0, self.columns, self.rows)] * self.count
        # The nearest background lies at most one pixel beside a silhouette's rectangle.
        rects = [cv2.boundingRect(padded) for padded in self.padded]
        self.rects = [(x - 1, y - 1, width + 2, height + 2) for x, y, width, height in rects]

    def project(self, points):
        """Columns and rows in the padded masks, times depth, and depths of points (3, n)."""
        kind = points.dtype
        image = self.products.astype(kind) @ points + self.offsets.astype(kind)
        return image.reshape(self.count, 3, -1)

    def direct(self, directions):
        """The same of directions."""
        return (self.products.astype(directions.dtype) @ directions).reshape(self.count, 3, -1)

    def places(self, image):
        """Where the masks hold the pixels of projected points."""
        inverse = 1.0 / image[:, 2]
        column, row = image[:, 0] * inverse, image[:, 1] * inverse
        np.clip(column, 0, self.columns - 1, out=column)
        np.clip(row, 0, self.rows - 1, out=row)
        place = row.astype(np.int32)
        place *= self.columns
        place += column.astype(np.int32)
        place += self.bases
        return place


class Transform:
    """What the distance transform of a frame says: the work that every new frame needs."""

    def __init__(self, frame, rects, buffers):
        self.frame = frame
        distances, labels = buffers
        self.distances, self.labels, self.zeros = distances.ravel(), labels.ravel(), []
        for camera, (x, y, width, height) in enumerate(rects):
            span = slice(y, y + height), slice(x, x + width)
            part = frame.padded[camera][span]
            cv2.distanceTransformWithLabels(
                part,
                cv2.DIST_L2,
                cv2.DIST_MASK_5,
                distances[camera][span],
                labels[camera][span],
                cv2.DIST_LABEL_PIXEL,
            )
            # Labels count background pixels from one, in reading order.
            zeros = np.flatnonzero(part == 0)
            if width < frame.columns:
                row, column = np.divmod(zeros, width)
                zeros = (row + y) * frame.columns + column + x
            self.zeros.append(zeros)

    @staticmethod
    def buffers(frame):
        """Room for transforms, kept from frame to frame."""
        shape = frame.count, frame.rows, frame.columns
        return np.zeros(shape, np.float32), np.zeros(shape, np.int32)

    def distance(self, places):
        """The distance from each place (cameras, n) to the nearest background, pixels."""
        return self.distances.take(places)

    def nearest(self, places):
        """The place of the background pixel nearest to each place on foreground."""
        labels = self.labels.take(places) - 1
        found = [zeros.take(label) for zeros, label in zip(self.zeros, labels)]
        return np.stack(found).astype(np.int32) + self.frame.bases

    def windows(self, places):
        """Sums of the vectors from pixels to the background of the window around them."""
        reach = np.arange(-self.frame.window, self.frame.window + 1)
        down, across = np.meshgrid(reach, reach, indexing="ij")
        steps = (down * self.frame.columns + across).ravel()
        vectors = np.stack([across.ravel(), down.ravel()]).astype(np.float32)
        sums = np.empty((2, len(places)))
        for start in range(0, len(places), WINDOW_BLOCK):
            block = places[start : start + WINDOW_BLOCK]
            background = self.frame.masks.take(steps[:, None] + block) ^ 1
            sums[:, start : start + WINDOW_BLOCK] = vectors @ background.astype(np.float32)
        return sums[0], sums[1]


class Tables:
    """The same for every pixel, made beforehand and not counted."""

    def __init__(self, frame):
        whole = Transform(frame, frame.whole, Transform.buffers(frame))
        self.distances = whole.distances
        labels = whole.labels.reshape(frame.count, -1)
        self.background = np.empty(labels.shape, np.int32)
        for camera, base in enumerate(frame.bases[:, 0]):
            places = (whole.zeros[camera] + base).astype(np.int32)
            places.take(labels[camera] - 1, out=self.background[camera])
        del whole, labels
        reach = np.arange(-frame.window, frame.window + 1, dtype=np.float32)
        ones = np.ones_like(reach)
        # Sums of a window fit 16 bits up to this one.
        depth = cv2.CV_16S if frame.window <= 30 else cv2.CV_32F
        sums = lambda padded, x, y: cv2.sepFilter2D(padded ^ 1, depth, x, y, borderType=cv2.BORDER_REPLICATE)
        self.across = np.concatenate([sums(padded, reach, ones).ravel() for padded in frame.padded])
        self.down = np.concatenate([sums(padded, ones, reach).ravel() for padded in frame.padded])

    def distance(self, places):
        """See Transform."""
        return self.distances.take(places)

    def nearest(self, places):
        """See Transform."""
        return self.background.take(places)

    def windows(self, places):
        """See Transform."""
        return self.across.take(places), self.down.take(places)


def inside(frame, points):
    """Which points (3, n) every camera sees as foreground."""
    products, offsets = frame.products.astype(points.dtype), frame.offsets.astype(points.dtype)
    masks = [padded.ravel() for padded in frame.padded]
    result = np.zeros(points.shape[1], bool)
    for start in range(0, points.shape[1], INSIDE_BLOCK):
        part = points[:, start : start + INSIDE_BLOCK]
        left = np.arange(start, start + part.shape[1])
        for camera, mask in enumerate(masks):
            rows = slice(3 * camera, 3 * camera + 3)
            column, row, depth = products[rows] @ part + offsets[rows]
            inverse = 1.0 / depth
            column *= inverse
            row *= inverse
            np.clip(column, 0, frame.columns - 1, out=column)
            np.clip(row, 0, frame.rows - 1, out=row)
            place = row.astype(np.int32)
            place *= frame.columns
            place += column.astype(np.int32)
            kept = np.flatnonzero(mask.take(place) * (depth > 0))
            part, left = part.take(kept, axis=1), left.take(kept)
        result[left] = True
    return result


def full_pass(frame, maps, points, body_points):
    """Every point's response and the distance to its edge (4, n), and every body's response (3, bodies); not
    a number where there is none."""
    start = frame.project(points)
    places = frame.places(start)
    kept = np.flatnonzero(frame.masks.take(places).all(axis=0))
    if kept.size < points.shape[1]:
        start, places = start[:, :, kept], places[:, kept]
    normals, edges_m = normals_world(frame, maps, points.take(kept, axis=1), places)
    responses = normals * exits(frame, maps, start, frame.direct(normals))
    body = kept // body_points
    first = np.flatnonzero(np.diff(body, prepend=-1))
    means = np.add.reduceat(np.nan_to_num(responses), first, axis=1)
    means /= np.sqrt((means * means).sum(axis=0))
    along = np.repeat(means, np.diff(first, append=kept.size), axis=1)
    ways = exits(frame, maps, start, frame.direct(along.astype(points.dtype)))
    result = np.full((4, points.shape[1]), np.nan)
    result[:3, kept], result[3, kept] = responses, edges_m
    return result, means * np.maximum.reduceat(ways, first)


def normals_world(frame, maps, points, places):
    """The hull's unit normals (3, n) at the edges nearest to points inside, whose places are given, and how
    far these are."""
    kind = points.dtype
    nearest = maps.nearest(places)
    row, column = np.divmod(nearest - frame.bases, frame.columns)
    focal = frame.matrices[:, [0, 1], [0, 1]].astype(kind)
    centre = frame.matrices[:, :2, 2].astype(kind) + frame.pad
    ray_x = (column - centre[:, :1]) / focal[:, :1]
    ray_y = (row - centre[:, 1:]) / focal[:, 1:]
    seen = frame.rotations.reshape(-1, 3).astype(kind) @ points
    seen = seen.reshape(frame.count, 3, -1) + frame.translations.astype(kind)
    cross_x = seen[:, 1] - seen[:, 2] * ray_y
    cross_y = seen[:, 2] * ray_x - seen[:, 0]
    cross_z = seen[:, 0] * ray_y - seen[:, 1] * ray_x
    squared = cross_x * cross_x + cross_y * cross_y + cross_z * cross_z
    squared /= 1 + ray_x * ray_x + ray_y * ray_y
    winner = squared.argmin(axis=0)
    each = np.arange(points.shape[1])
    across, down = maps.windows(nearest[winner, each])
    blank = np.flatnonzero((across == 0) & (down == 0))
    if blank.size:
        at = winner[blank], blank
        start_row, start_column = np.divmod(places[at] - frame.bases[at[0], 0], frame.columns)
        across[blank], down[blank] = column[at] - start_column, row[at] - start_row
    x, y = across * focal[winner, 0], down * focal[winner, 1]
    normal = np.stack([x, y, -(ray_x[winner, each] * x + ray_y[winner, each] * y)], axis=1)
    normal = np.matmul(normal[:, None, :], frame.rotations[winner])[:, 0, :].T
    normal = (normal / np.sqrt((normal * normal).sum(axis=0))).astype(kind)
    return normal, np.sqrt(squared[winner, each])


def exits(frame, maps, start, step):
    """How far along the rays (cameras, 3, n) some camera sees background; not a number if nowhere."""
    kind = start.dtype
    found = np.full(start.shape[2], np.nan, kind)
    spans = frame.spans.astype(kind)
    left = np.arange(start.shape[2])
    reached, way = np.zeros(left.size, kind), np.zeros(left.size, kind)
    for _ in range(MAX_STEPS):
        image = start + step * reached
        room = maps.distance(frame.places(image)) - 1.0
        span = image[:, 2] * spans
        # The least room of all cameras, metres; negative where one sees background.
        least = (room * span).min(axis=0)
        out = np.flatnonzero(least < 0)
        if out.size:
            found[left[out]] = halved(frame, start[:, :, out], step[:, :, out], reached[out], way[out])
        going = np.flatnonzero((least >= 0) & (reached < frame.max_depth_m))
        if not going.size:
            break
        if going.size < left.size:
            start, step, left = start[:, :, going], step[:, :, going], left[going]
            reached, least, span = reached[going], least[going], span[:, going]
        way = np.maximum(0.9 * least, 0.5 * span.min(axis=0)).astype(kind)
        reached = reached + way
    return found


def halved(frame, start, step, end, way):
    """The last step of rays that left, halved until it is fine."""
    low, high = end - way, end
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        stays = frame.masks.take(frame.places(start + step * middle)).all(axis=0)
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
    return high


class Bench:
    """The requests."""

    def frame(self, request):
        """Takes cameras and masks; forgets those before."""
        self.points, self.took_s = {}, {"opencv_with_transform": [], "opencv_with_cropped_transform": []}
        self.tables, self.made = None, {}
        self.shown = Frame(request)
        self.tables = Tables(self.shown)
        self.buffers = {engine: Transform.buffers(self.shown) for engine in self.took_s}
        return {}

    def points_of(self, request):
        """Takes points under a name."""
        points = np.ascontiguousarray(np.fromfile(request["file"]).reshape(-1, 3).T)
        self.points[request["load"]] = points, request["body_points"]
        return {}

    def work(self, request):
        """What an engine does with a load, and how many points it counts."""
        points, body_points = self.points[request["load"]]
        engine = request.get("engine", "opencv")
        if engine == "opencv_single_precision":
            points = points.astype(np.float32)
        if request["load"] == "inside":
            return points.shape[1], lambda: inside(self.shown, points)
        maps = self.tables
        if engine in self.took_s:
            maps = self.transformed(engine)
        return points.shape[1], lambda: full_pass(self.shown, maps, points, body_points)

    def transformed(self, engine):
        """A frame's transform; how long it took is remembered."""
        rects = self.shown.whole if engine == "opencv_with_transform" else self.shown.rects
        if engine not in self.made:
            # Touches the memory once, so that no transform that is timed pays for it.
            self.made[engine] = Transform(self.shown, rects, self.buffers[engine])
        if len(self.took_s[engine]) < TRANSFORMS:
            began = time.thread_time()
            self.made[engine] = Transform(self.shown, rects, self.buffers[engine])
            self.took_s[engine].append(time.thread_time() - began)
        return self.made[engine]

    def measure(self, request):
        """One repetition: points per second of this thread's processor time."""
        count, work = self.work(request)
        # The transform, if the engine counts it, once for the points of a frame.
        times = sorted(self.took_s.get(request["engine"], []))
        transform_s = times[len(times) // 2] if times else 0.0
        began, rounds = time.thread_time(), 0
        while True:
            work()
            rounds += 1
            took = time.thread_time() - began
            if took >= request["seconds"]:
                return {"points_per_s": rounds * count / (took + rounds * transform_s)}

    def answers(self, request):
        """Writes what it finds: of the inside test a number a point, of a pass four."""
        count, work = self.work(request)
        found = work()
        found = found if request["load"] == "inside" else found[0].T
        np.ascontiguousarray(found, np.float64).tofile(request["file"])
        return {"points": count}


def main():
    """Answers requests until there are no more."""
    cv2.setNumThreads(1)
    np.seterr(all="ignore")
    bench = Bench()
    verbs = {"frame": bench.frame, "points": bench.points_of, "measure": bench.measure, "answers": bench.answers}
    versions = {"python": sys.version.split()[0], "opencv": cv2.__version__, "numpy": np.__version__}
    print(json.dumps({"ready": True, **versions}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        print(json.dumps(verbs[request["do"]](request)), flush=True)


if __name__ == "__main__":
    main()

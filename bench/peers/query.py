"""OpenCV and NumPy on the work of `hulltouch-bench query`, on one thread.

Reads one JSON request a line from standard input and answers each with one line. `hulltouch-bench query`
starts it and hands over the same masks and points that it asks itself; see docs/performance.md.

The steps are the paper's (sections 4 and 5) as one writes them with these libraries: projection by matrix
products, lookup by indexing, the nearest background pixel from a distance transform with labels, and
exits by marching all points at once, each step as long as the transform allows. The inside test goes in
blocks that fit the cache and drops rejected points camera by camera; a pass takes a frame's points at once
in all cameras, which was the fastest of the block sizes tried.

A contact pass finds planes of the hull's surface: of samples inside at the nearest background pixel, of points
around their bodies at the nearest foreground pixel of every camera that sees them beside it, which takes a
second transform. The straight edge there is that of the background within a disc.
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
# No point around a body is nearer to a camera, metres.
LEAST_DEPTH_M = 1.5
# Shares of a disc for which the chord's place is looked up.
SHARES = 4_096
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


class Disc:
    """The pixels no farther than a radius and a half from a pixel, and where a straight edge crosses them."""

    def __init__(self, radius, columns):
        reach = np.arange(-radius, radius + 1)
        down, across = np.meshgrid(reach, reach, indexing="ij")
        self.mask = across * across + down * down <= radius * radius + radius
        self.across, self.down = across * self.mask, down * self.mask
        self.steps = (down * columns + across)[self.mask]
        self.vectors = np.stack([across[self.mask], down[self.mask], np.ones(self.steps.size)]).astype(np.float32)
        # The background's share of a disc, by how far towards the background its edge is.
        place = np.linspace(1, -1, SHARES)
        shares = (np.arccos(place) - place * np.sqrt(1 - place * place)) / np.pi
        counts = np.arange(self.steps.size + 1) / self.steps.size
        self.offsets = np.interp(counts, shares, place) * np.sqrt(self.steps.size / np.pi)


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
        # The same with what lies around bodies.
        self.around_m = request["around_m"]
        reach = int(self.around_m * self.matrices[:, [0, 1], [0, 1]].max() / LEAST_DEPTH_M) + 1
        self.wide_rects = [self.grown(rect, reach) for rect in self.rects]
        self.centres = -np.einsum("kji,kj->ki", self.rotations, self.translations[:, :, 0])
        self.disc = Disc(self.window, self.columns)

    def grown(self, rect, by):
        """A rectangle with a border, within the padded image."""
        left, top = max(rect[0] - by, 0), max(rect[1] - by, 0)
        right = min(rect[0] + rect[2] + by, self.columns)
        return left, top, right - left, min(rect[1] + rect[3] + by, self.rows) - top

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

    def discs(self, places):
        """Sums of the vectors to the background of the disc around places, and how many pixels it has."""
        disc, sums = self.frame.disc, np.empty((3, len(places)), np.float32)
        for start in range(0, len(places), WINDOW_BLOCK):
            block = places[start : start + WINDOW_BLOCK]
            background = self.frame.masks.take(disc.steps[:, None] + block) ^ 1
            sums[:, start : start + WINDOW_BLOCK] = disc.vectors @ background.astype(np.float32)
        return sums[0], sums[1], sums[2].astype(np.int32)

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


class Beside:
    """The foreground pixel nearest to what cameras see beside it: a transform of the background."""

    def __init__(self, frame, rects, buffers):
        distances, self.labels = buffers
        self.frame, self.ones = frame, []
        for camera, (x, y, width, height) in enumerate(rects):
            span = slice(y, y + height), slice(x, x + width)
            part = frame.padded[camera][span] ^ 1
            cv2.distanceTransformWithLabels(
                part,
                cv2.DIST_L2,
                cv2.DIST_MASK_5,
                distances[camera][span],
                self.labels[camera][span],
                cv2.DIST_LABEL_PIXEL,
            )
            row, column = np.divmod(np.flatnonzero(part == 0), width)
            places = (row + y) * frame.columns + column + x + frame.bases[camera, 0]
            # Label 0 is beyond the rectangle: too far away.
            self.ones.append(np.concatenate([[-1], places]).astype(np.int32))

    def nearest(self, cameras, places):
        """The place of the foreground pixel nearest to each place of a camera; negative if none is near."""
        labels, found = self.labels.ravel().take(places), np.empty(len(places), np.int32)
        for camera, ones in enumerate(self.ones):
            of_camera = np.flatnonzero(cameras == camera)
            found[of_camera] = ones.take(labels[of_camera])
        return found


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


class ContactTables(Tables):
    """The same for contact passes, which sum discs; from the tables of full passes."""

    def __init__(self, frame, tables):
        self.distances, self.background = tables.distances, tables.background
        beside = Beside(frame, frame.wide_rects, Transform.buffers(frame))
        places = np.arange(frame.masks.size, dtype=np.int32).reshape(frame.count, -1)
        self.foreground = np.concatenate(
            [beside.nearest(np.full(row.size, camera), row) for camera, row in enumerate(places)]
        )
        del beside, places
        kinds = [frame.disc.across, frame.disc.down, frame.disc.mask]
        kernels = [kind.astype(np.float32) for kind in kinds]
        sums = lambda padded, kernel: cv2.filter2D(padded ^ 1, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
        self.sums = [
            np.concatenate([np.rint(sums(padded, kernel)).astype(np.int16).ravel() for padded in frame.padded])
            for kernel in kernels
        ]

    def discs(self, places):
        """See Transform."""
        return tuple(sums.take(places) for sums in self.sums)

    def beside(self, cameras, places):
        """See Beside.nearest."""
        return self.foreground.take(places)


class ContactTransform(Transform):
    """Both transforms of a frame, of the silhouettes' rectangles alone."""

    def __init__(self, frame, buffers, buffers_beside):
        super().__init__(frame, frame.rects, buffers)
        self.of_background = Beside(frame, frame.wide_rects, buffers_beside)

    def beside(self, cameras, places):
        """See Beside.nearest."""
        return self.of_background.nearest(cameras, places)


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


def contact_pass(frame, maps, probes, around, body_probes, body_around):
    """Of every probe inside, and after them of every point around the bodies that have one, its plane (5, n): its
    normal, how deep the point is below it, and how far the nearest edge is; not a number where there is none."""
    result = np.full((5, probes.shape[1] + around.shape[1]), np.nan)
    kept = np.flatnonzero(inside(frame, probes))
    points = probes.take(kept, axis=1)
    result[:, kept] = planes_inside(frame, maps, points, frame.places(frame.project(points)))
    touched = np.unique(kept // body_probes)
    near = (touched[:, None] * body_around + np.arange(body_around)).ravel()
    points = around.take(near, axis=1)
    start = frame.project(points)
    places = frame.places(start)
    seen = frame.masks.take(places) != 0
    within = seen.all(axis=0)
    found = np.full((5, near.size), np.nan)
    found[:, within] = planes_inside(frame, maps, points[:, within], places[:, within])
    out, planes = planes_beside(frame, maps, points, start[:, 2], places, seen)
    found[:, out] = planes
    # Where no silhouette is near, the edges of those that see it inside, as near.
    left = np.flatnonzero(np.isnan(found[3]) & seen.any(axis=0) & ~within)
    planes = planes_inside(frame, maps, points.take(left, axis=1), places[:, left], seen[:, left])
    is_near = planes[4] <= frame.around_m
    found[:, left[is_near]] = planes[:, is_near]
    result[:, probes.shape[1] + near] = found
    return result


def planes_inside(frame, maps, points, places, judging=None):
    """The planes (5, n) at the edges nearest to points inside, whose places are given; of those cameras alone that see
    a point inside, if that is told."""
    winner, nearest, edges_m = edge_rays(frame, maps, points, places, judging)[:3]
    each = np.arange(points.shape[1])
    planes = planes_at(frame, maps, winner, nearest[winner, each], places[winner, each], points)
    return np.concatenate([planes, edges_m[None]])


def planes_beside(frame, maps, points, depths, places, seen):
    """Which points some camera sees beside its silhouette and near it, and their planes (5, n): of the cameras'
    planes the one that is farthest."""
    cameras, which = np.nonzero(~seen)
    start = places[cameras, which]
    found = maps.beside(cameras, start)
    kept = np.flatnonzero(found >= 0)
    cameras, which, start, found = cameras[kept], which[kept], start[kept], found[kept]
    base = frame.bases[cameras, 0]
    row, column = np.divmod(found - base, frame.columns)
    start_row, start_column = np.divmod(start - base, frame.columns)
    down, across = start_row - row, start_column - column
    depth = depths[cameras, which]
    beyond = np.sqrt(((frame.centres[cameras].T - points.take(which, axis=1)) ** 2).sum(axis=0))
    tangents = frame.around_m * beyond / (depth * (depth - frame.around_m))
    limits = tangents / frame.spans[cameras, 0] + 0.7073
    kept = np.flatnonzero(down * down + across * across <= limits * limits)
    cameras, which, found, down, across = (a[kept] for a in (cameras, which, found, down, across))
    is_level = np.abs(across) >= np.abs(down)
    edge = found + np.where(is_level, np.sign(across), np.sign(down) * frame.columns)
    planes = planes_at(frame, maps, cameras, edge, found, points.take(which, axis=1))
    planes[3] = np.minimum(planes[3], 0)
    order = np.lexsort((planes[3], which))
    out, first = np.unique(which[order], return_index=True)
    planes = planes[:, order[first]]
    return out, np.concatenate([planes, planes[3:]])


def planes_at(frame, maps, cameras, edges, starts, points):
    """The planes (4, n) through cameras' centres and the straight edges at their edge pixels."""
    kind = points.dtype
    base = frame.bases[cameras, 0]
    row, column = np.divmod(edges - base, frame.columns)
    across, down, count = maps.discs(edges)
    blank = (across == 0) & (down == 0)
    if blank.any():
        start_row, start_column = np.divmod(starts - base, frame.columns)
        across, down = np.where(blank, column - start_column, across), np.where(blank, row - start_row, down)
    across, down = across.astype(kind), down.astype(kind)
    length = np.sqrt(across * across + down * down)
    across, down = across / length, down / length
    offset = frame.disc.offsets.astype(kind).take(count)
    focal_x, focal_y = frame.matrices[cameras, 0, 0].astype(kind), frame.matrices[cameras, 1, 1].astype(kind)
    centre_x, centre_y = frame.matrices[cameras, 0, 2].astype(kind), frame.matrices[cameras, 1, 2].astype(kind)
    ray_x = (column - frame.pad + across * offset - centre_x) / focal_x
    ray_y = (row - frame.pad + down * offset - centre_y) / focal_y
    x, y = across * focal_x, down * focal_y
    normal = np.stack([x, y, -(ray_x * x + ray_y * y)], axis=1)
    normal = np.matmul(normal[:, None, :], frame.rotations.astype(kind)[cameras])[:, 0, :].T
    normal = normal / np.sqrt((normal * normal).sum(axis=0))
    depth = (normal * (frame.centres.astype(kind)[cameras].T - points)).sum(axis=0)
    return np.concatenate([normal, depth[None]])


def edge_rays(frame, maps, points, places, judging=None):
    """The camera whose edge is nearest to each point inside, all cameras' edge pixels, how far the edges are, and all
    cameras' rays through them (cameras, n)."""
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
    if judging is not None:
        squared = np.where(judging, squared, np.inf)
    winner = squared.argmin(axis=0)
    return winner, nearest, np.sqrt(squared[winner, np.arange(points.shape[1])]), ray_x, ray_y


def normals_world(frame, maps, points, places):
    """The hull's unit normals (3, n) at the edges nearest to points inside, whose places are given, and how
    far these are."""
    kind = points.dtype
    winner, nearest, edges_m, ray_x, ray_y = edge_rays(frame, maps, points, places)
    each = np.arange(points.shape[1])
    focal = frame.matrices[:, [0, 1], [0, 1]].astype(kind)
    across, down = maps.windows(nearest[winner, each])
    blank = np.flatnonzero((across == 0) & (down == 0))
    if blank.size:
        at = winner[blank], blank
        base = frame.bases[at[0], 0]
        row, column = np.divmod(nearest[at] - base, frame.columns)
        start_row, start_column = np.divmod(places[at] - base, frame.columns)
        across[blank], down[blank] = column - start_column, row - start_row
    x, y = across * focal[winner, 0], down * focal[winner, 1]
    normal = np.stack([x, y, -(ray_x[winner, each] * x + ray_y[winner, each] * y)], axis=1)
    normal = np.matmul(normal[:, None, :], frame.rotations[winner])[:, 0, :].T
    normal = (normal / np.sqrt((normal * normal).sum(axis=0))).astype(kind)
    return normal, edges_m


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
        self.points, self.made, self.took_s = {}, {}, {}
        self.tables, self.contact_tables = None, None
        self.shown = Frame(request)
        self.tables = Tables(self.shown)
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
        kind = np.float32 if engine == "opencv_single_precision" else np.float64
        points = points.astype(kind)
        if request["load"] == "inside":
            return points.shape[1], lambda: inside(self.shown, points)
        is_of_contacts = request["load"] == "touching"
        if "transform" in engine:
            maps = self.transformed(engine, is_of_contacts)
        elif is_of_contacts:
            self.contact_tables = self.contact_tables or ContactTables(self.shown, self.tables)
            maps = self.contact_tables
        else:
            maps = self.tables
        if is_of_contacts:
            around, body_around = self.points["touching_around"]
            around = around.astype(kind)
            work = lambda: contact_pass(self.shown, maps, points, around, body_points, body_around)
        else:
            work = lambda: full_pass(self.shown, maps, points, body_points)
        return points.shape[1], work

    def transformed(self, engine, is_of_contacts):
        """A frame's transforms; how long they took is remembered."""
        key, frame = (engine, is_of_contacts), self.shown
        if key not in self.made:
            buffers, beside = Transform.buffers(frame), Transform.buffers(frame) if is_of_contacts else None
            rects = frame.whole if engine == "opencv_with_transform" else frame.rects
            if is_of_contacts:
                make = lambda: ContactTransform(frame, buffers, beside)
            else:
                make = lambda: Transform(frame, rects, buffers)
            # The first touches the memory, so that no transform that is timed pays for it.
            self.made[key], self.took_s[key] = make(), []
            for _ in range(TRANSFORMS):
                began = time.thread_time()
                self.made[key] = make()
                self.took_s[key].append(time.thread_time() - began)
        return self.made[key]

    def measure(self, request):
        """One repetition: points per second of this thread's processor time."""
        count, work = self.work(request)
        # The transform, if the engine counts it, once for the points of a frame.
        times = sorted(self.took_s.get((request["engine"], request["load"] == "touching"), []))
        transform_s = times[len(times) // 2] if times else 0.0
        began, rounds = time.thread_time(), 0
        while True:
            work()
            rounds += 1
            took = time.thread_time() - began
            if took >= request["seconds"]:
                return {"points_per_s": rounds * count / (took + rounds * transform_s)}

    def answers(self, request):
        """Writes what it finds: of the inside test a number a point, of a pass four, of a contact pass five."""
        load, found = request["load"], self.work(request)[1]()
        found = {"inside": lambda: found, "touching": lambda: found.T}.get(load, lambda: found[0].T)()
        np.ascontiguousarray(found, np.float64).tofile(request["file"])
        return {"points": len(found)}


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

"""OpenCV's background subtraction on the work of `hulltouch-bench segment`, on one thread.

Reads one JSON request a line from standard input and answers each with one line. `hulltouch-bench segment`
starts it and hands over the same RGB frames that it segments itself; see docs/performance.md.

Both engines learn from the frames of the empty room and are then frozen, as ours is. `mog2` is OpenCV's
MOG2 with its defaults, shadow detection on and shadows taken as background; `mog2_i420` is the same on the
frames that a camera gives as I420, which OpenCV turns into RGB first; `difference` is the absolute
difference to the mean frame, its grey level over a threshold. What is timed ends with a mask of a byte a
pixel, without clean-up. Masks are also given after a clean-up (opening and closing by squares as wide as
ours, and the largest piece alone where ours keeps that), which is not timed.
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

# Grey levels that a pixel may differ from the mean frame's.
DIFFERENCE_LEVELS = 25


class Bench:
    """One scene: the empty room is learnt, the film is in memory."""

    def scene(self, request):
        """Takes the files of a scene."""
        shape = (-1, request["height"], request["width"], 3)
        background = np.memmap(request["background"], np.uint8, "r").reshape(shape)
        film = np.fromfile(request["film"], np.uint8).reshape(shape)
        self.films = {"mog2": film, "difference": film}
        self.mog2 = cv2.createBackgroundSubtractorMOG2()
        self.rgb = np.empty(shape[1:], np.uint8)
        if request["i420"]:
            planes = (-1, request["height"] * 3 // 2, request["width"])
            self.films["mog2_i420"] = np.fromfile(request["film_i420"], np.uint8).reshape(planes)
            self.mog2_i420 = cv2.createBackgroundSubtractorMOG2()
            for frame in np.memmap(request["background_i420"], np.uint8, "r").reshape(planes):
                self.mog2_i420.apply(cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_YUV2RGB_I420))
        total = np.zeros(shape[1:], np.uint32)
        for frame in background:
            frame = np.ascontiguousarray(frame)
            self.mog2.apply(frame)
            total += frame
        count = len(background)
        self.mean = ((total + count // 2) // count).astype(np.uint8)
        self.foreground = np.empty(shape[1:3], np.uint8)
        self.apart = np.empty(shape[1:], np.uint8)
        self.grey = np.empty(shape[1:3], np.uint8)
        return {"frames": len(film)}

    def work(self, engine, frame):
        """A mask: foreground is 255."""
        if engine == "mog2":
            # Shadows are 127.
            self.foreground = self.mog2.apply(frame, self.foreground, 0)
            return self.foreground
        if engine == "mog2_i420":
            cv2.cvtColor(frame, cv2.COLOR_YUV2RGB_I420, self.rgb)
            self.foreground = self.mog2_i420.apply(self.rgb, self.foreground, 0)
            return self.foreground
        cv2.absdiff(frame, self.mean, self.apart)
        cv2.cvtColor(self.apart, cv2.COLOR_RGB2GRAY, self.grey)
        return cv2.threshold(self.grey, DIFFERENCE_LEVELS, 255, cv2.THRESH_BINARY, self.foreground)[1]

    def turn(self, request):
        """Processor seconds of this thread for each frame of the film."""
        seconds = []
        for frame in self.films[request["engine"]]:
            began = time.thread_time()
            self.work(request["engine"], frame)
            seconds.append(time.thread_time() - began)
        return {"seconds": seconds}

    def masks(self, request):
        """Writes the masks of all frames, as they are and cleaned."""
        raw, cleaned = [], []
        for frame in self.films[request["engine"]]:
            mask = (self.work(request["engine"], frame) == 255).astype(np.uint8) * 255
            raw.append(mask)
            cleaned.append(clean(mask, request))
        np.stack(raw).tofile(request["raw"])
        np.stack(cleaned).tofile(request["cleaned"])
        return {"frames": len(raw)}


def clean(mask, request):
    """The mask opened and closed, and its largest piece alone if asked for."""
    for operation, side in ((cv2.MORPH_OPEN, request["open"]), (cv2.MORPH_CLOSE, request["close"])):
        mask = cv2.morphologyEx(mask, operation, np.ones((side, side), np.uint8))
    if request["largest"]:
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
        if count > 1:
            largest = 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
            mask = (labels == largest).astype(np.uint8) * 255
    return mask


def main():
    """Answers requests until there are no more."""
    cv2.setNumThreads(1)
    bench = Bench()
    verbs = {"scene": bench.scene, "turn": bench.turn, "masks": bench.masks}
    versions = {"python": sys.version.split()[0], "opencv": cv2.__version__, "numpy": np.__version__}
    print(json.dumps({"ready": True, **versions}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        print(json.dumps(verbs[request["do"]](request)), flush=True)


if __name__ == "__main__":
    main()

"""Times OpenCV's way from a Bayer frame to the largest red object, one thread: demosaic, red mask, connected components with
statistics. `opencv_chain.py FOLDER` prints seconds of the thread and the centre a frame, for docs/results/tracker.md."""

import sys
import time
from pathlib import Path

import cv2
import numpy as np

cv2.setNumThreads(1)


def largest_red(bayer):
    # OpenCV names a pattern by its second row and column: GRBG is its "GB".
    hsv = cv2.cvtColor(cv2.cvtColor(bayer, cv2.COLOR_BayerGB2BGR), cv2.COLOR_BGR2HSV)
    mask = cv2.bitwise_or(
        cv2.inRange(hsv, (0, 105, 70), (10, 255, 255)), cv2.inRange(hsv, (170, 105, 70), (180, 255, 255))
    )
    count, _, statistics, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return -1.0, -1.0
    return tuple(centres[1 + np.argmax(statistics[1:, cv2.CC_STAT_AREA])])


frames = [np.fromfile(path, np.uint8).reshape(480, 640) for path in sorted(Path(sys.argv[1]).glob("*.bayer"))]
for frame in frames[:20]:
    largest_red(frame)
for frame in frames:
    began = time.thread_time()
    x, y = largest_red(frame)
    print(f"{time.thread_time() - began:.9f} {x:.2f} {y:.2f}")

"""People by OpenCV 4's HOG and SVM (Dalal and Triggs 2005), run by a Python that has them.

    python hog_people.py VIDEO FIRST END OUT.txt STEP WIDTH HEIGHT

OpenCV 5 has no HOG, so that this file runs in a virtual environment of its own and imports nothing of pilsim.
Images are scaled to WIDTH x HEIGHT and then doubled, since the window is 128 px high.
Windows have margins, which the boxes leave out, and are suppressed at an IoU of 0.5.
"""

import sys
import time

import cv2
import numpy as np

SCALE, MARGIN = 2.0, (16 / 64, 16 / 128)
"""Of the image; share of a window's width and height on each side that is no person: 16 of 64 x 128 px (Dalal and Triggs 2005, section 4)."""


def found(hog, image):
    """Boxes (n, 4) left, top, width, height px and scores (n,)."""
    large = cv2.resize(image, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
    windows, scores = hog.detectMultiScale(large, hitThreshold=-0.5, winStride=(8, 8), padding=(16, 16), scale=1.05, groupThreshold=0)
    box, scores = np.array(windows, dtype=float).reshape(-1, 4) / SCALE, np.array(scores, dtype=float).ravel()
    size = box[:, 2:].copy()
    box[:, :2] += size * MARGIN
    box[:, 2:] = size * (1 - 2 * np.array(MARGIN))
    kept = cv2.dnn.NMSBoxes(box.tolist(), (scores - scores.min() + 1).tolist(), 0.0, 0.5) if len(box) else []
    kept = np.array(kept, dtype=int).ravel()
    return box[kept], scores[kept]


def main():
    video, out = sys.argv[1], sys.argv[4]
    first, end, step, width, height = (int(word) for word in (*sys.argv[2:4], *sys.argv[5:8]))
    cv2.setNumThreads(1)
    hog = cv2.HOGDescriptor()
    hog.setSVMDetector(cv2.HOGDescriptor_getDefaultPeopleDetector())
    capture, seconds, lines = cv2.VideoCapture(video), 0.0, []
    for frame in range(end):
        _, image = capture.read()
        if frame < first or (frame - first) % step:
            continue
        if image.shape[:2] != (height, width):
            image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        start = time.thread_time()
        boxes, scores = found(hog, image)
        seconds += time.thread_time() - start
        lines += [f"{frame + 1},-1,{','.join(f'{v:.2f}' for v in box)},{score:.4f},-1,-1,-1\n" for box, score in zip(boxes, scores, strict=True)]
    with open(out, "w") as file:
        file.writelines(lines)
    print(1000 * seconds / len(range(first, end, step)))


if __name__ == "__main__":
    main()

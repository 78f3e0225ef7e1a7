"""Time and memory of `pilsim import` of a large bag: JPEG panoramas of noise at 10/s, and odometry at 20/s, written by rosbags.

`python -m tests.benchmarks.bags --gigabytes 2 --form mcap`
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from tests.tracker.formats.ros.robot_bag import COMPRESSED, EPOCH, FORMS, MOUNT, ODOMETRY, OPTICAL, TF, Row, pose_at, write_bag
from tracker.formats.ros.messages import header, pose_message, transform

WIDTH, RATE = 2048, 10


def rows(size: int) -> Iterator[Row]:
    """Messages whose images have `size` bytes together."""
    noise = np.random.default_rng(0).integers(0, 256, (WIDTH // 2, WIDTH, 3), dtype=np.uint8)
    image = cv2.imencode(".jpg", noise)[1].tobytes()
    mounts = [transform("base_link", "camera", MOUNT, EPOCH), transform("camera", "pano_optical", OPTICAL, EPOCH)]
    yield "/tf_static", TF, {"transforms": mounts}, EPOCH
    for k in range(size // len(image)):
        stamp = EPOCH + k * 10**9 // RATE
        yield "/pano/compressed", COMPRESSED, {"header": header(stamp, "pano_optical"), "format": "jpeg", "data": image}, stamp
        for half in range(2):
            moment = stamp + half * 10**9 // RATE // 2
            pose = {"pose": pose_message(pose_at((moment - EPOCH) / 1e9))}
            yield "/odom", ODOMETRY, {"header": header(moment, "odom"), "child_frame_id": "base_link", "pose": pose}, moment


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--form", choices=FORMS, default="mcap")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bag = write_bag(Path(folder) / "bag", options.form, rows(round(options.gigabytes * 1e9)))
        size = sum(file.stat().st_size for file in (bag.rglob("*") if bag.is_dir() else [bag]) if file.is_file())
        words = ("import", str(bag), "--camera", "/pano/compressed=panorama", "--odometry", "/odom", "--out", f"{folder}/out")
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "pilsim", *words], check=True)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        seconds, memory = time.monotonic() - began, used.ru_maxrss / 1024
        print(f"{options.form}: {size / 1e9:.2f} GB in {seconds:.0f} s, {processor:.0f} s of processor, {memory:.0f} MB")


if __name__ == "__main__":
    main()

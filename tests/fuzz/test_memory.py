"""Numbers in files that decide how much memory is taken: each reader bounds them, or reads them within 10 s and 1 GiB."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.client import Client
from tests.fuzz.readers import READERS
from tests.fuzz.samples import SIZE
from tracker.io.image_files import decode_image

Change = Callable[[str], str]
LARGE = (2**31 - 1, 2**40, 2**53 - 1, 10**30, 199_999)
"""The last one is within the bound of frames: a value for each of them has to fit."""


@pytest.fixture(scope="module")
def worker() -> Iterator[Client]:
    with Client() as client:
        yield client


def by(pattern: str, put: str) -> Change:
    """A number in a file → N, at the first match."""
    return lambda text: re.sub(pattern, put, text, count=1, flags=re.MULTILINE)


NUMBERS: dict[tuple[str, str], Change] = {
    ("MOT15 truth", "frame"): by(r"\A1,", "N,"),
    ("MOT15 truth", "id"): by(r"\A1,4", "1,N"),
    ("CVML", "frame"): by(r'number="2"', 'number="N"'),
    ("CVML", "id"): by(r'id="1"', 'id="N"'),
    ("Tsai", "width"): by(r' width="\d+"', ' width="N"'),
    ("Tsai", "height"): by(r' height="\d+"', ' height="N"'),
    ("PETS 2009 detections/View_001.txt", "frame"): by(r"^3,", "N,"),
    ("PETS 2009 annotations/PETS-cropped.xml", "frame"): by(r'number="2"', 'number="N"'),
    ("PETS 2009 calibration/View_001.xml", "width"): by(r' width="\d+"', ' width="N"'),
    ("PETS 2009 site.json", "rate"): by(r'"rate": [\d.]+', '"rate": N'),
    ("PETS 2009 site.json", "area"): by(r"4\.0", "N"),
    ("recording detections/C1.txt", "frame"): by(r"^3,", "N,"),
    ("recording truth.txt", "frame"): by(r"^3,", "N,"),
    ("recording odometry.csv", "frame"): by(r"^3,", "N,"),
    ("recording recording.json", "width"): by(r'"width": \d+', '"width": N'),
    ("recording recording.json", "rate"): by(r'"rate": [\d.]+', '"rate": N'),
    ("AI City calibration.json", "width"): by(r'("name": "frameWidth",\s+"value": ")\d+', r"\g<1>N"),
    ("AI City ground_truth.json", "frame"): by(r'"2":', '"N":'),
    ("AI City detections/Camera.txt", "frame"): by(r"^3,", "N,"),
    ("JRDB 2-D", "frame"): by(r'"000001', '"N'),
    ("JRDB 3-D", "id"): by(r"pedestrian:4", "pedestrian:N"),
    ("MultiviewX annotations_positions/00001.json", "position"): by(r'"positionID": \d+', '"positionID": N'),
    ("WILDTRACK config.json", "grid"): by(r'("grid_shape": \[\s*)\d+', r"\g<1>N"),
    ("DIMACS", "vertices"): by(r"p edge 4", "p edge N"),
    ("sequence truth/people.csv", "frame"): by(r"^2,4", "N,4"),
    ("sequence truth/people.csv", "person"): by(r"^2,4", "2,N"),
    ("sequence truth/robots.csv", "frame"): by(r"^2,", "N,"),
    ("sequence odometry.csv", "frame"): by(r"^2,", "N,"),
    ("sequence truth/boxes.csv", "frame"): by(r"^2,", "N,"),
    ("sequence truth/joints.csv", "frame"): by(r"^2,", "N,"),
    ("sequence calibration.json", "width"): by(r'"width": \d+', '"width": N'),
    ("sequence calibration.json", "period"): by(r'"period": [\d.]+', '"period": N'),
    ("results run.json", "frames"): by(r'"frames": 3', '"frames": N'),
    ("results tracks.txt", "frame"): by(r"^3,", "N,"),
    ("results robots.csv", "frame"): by(r"^2,", "N,"),
    ("results sightings.csv", "frame"): by(r"^2,", "N,"),
    ("results sightings.csv", "landmark"): by(r"7$", "N"),
    ("planar results robots.csv", "robot"): by(r",1,", ",N,"),
    ("UTIAS Barcodes", "code"): by(r"72", "N"),
    ("UTIAS Robot1_Odometry", "time"): by(r"^1059\.0+", "N"),
    ("UTIAS Robot1_Measurement", "time"): by(r"^1059\.0+", "N"),
    ("UTIAS Robot1_Groundtruth", "time"): by(r"^1059\.0+", "N"),
    ("stress report", "frames"): by(r'"frames": \d+', '"frames": N'),
    ("stress report", "seed"): by(r'"seed": \d+', '"seed": N'),
    ("settings TOML", "frames"): by(r"frames = \d+", "frames = N"),
}


@pytest.mark.command
@pytest.mark.parametrize(("name", "field"), NUMBERS)
def test_large_numbers_take_little_memory(worker: Client, tmp_path: Path, name: str, field: str) -> None:
    reader, change = READERS[name], NUMBERS[name, field]
    reader.make(tmp_path)
    text = (tmp_path / reader.file).read_text(encoding="utf-8")
    changed = change(text)
    assert changed != text
    answer = worker.ask({"reader": name, "way": "given", "inputs": [changed.replace("N", str(number)) for number in LARGE]}, 60.0)
    assert not answer.get("faults", answer), answer


def png(width: int, height: int) -> bytes:
    """A PNG of one row whose header claims another size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


@pytest.mark.command
@pytest.mark.parametrize("size", [(2**31 - 1, 2**31 - 1), (60_000, 60_000), SIZE[::-1]])
def test_images_that_claim_a_size_are_refused(worker: Client, size: tuple[int, int]) -> None:
    for name in ("PNG", "stress picture", "sequence instances", "recording images/P/000002.png"):
        answer = worker.ask({"reader": name, "way": "given", "inputs": [png(*size).decode("latin-1")]}, 60.0)
        assert not answer.get("faults", answer), answer
    with pytest.raises(ValueError, match=r"px, needs|is truncated or damaged|is no image"):
        decode_image(png(*size), SIZE)


@pytest.mark.command
def test_large_graph_without_edges_is_refused(worker: Client) -> None:
    answer = worker.ask({"reader": "DIMACS", "way": "given", "inputs": [f"p edge {n} 0\n" for n in (20_000, 6_000)]}, 60.0)
    assert not answer.get("faults", answer), answer
    assert answer["refused"] == 2


@pytest.mark.command
def test_arrays_that_claim_a_size_are_refused(worker: Client, tmp_path: Path) -> None:
    """Zeros compress to a thousandth: 400 kB of file for 400 MB."""
    zeros = np.zeros((10_000, 5_000))
    np.savez_compressed(tmp_path / "a.npz", heights=zeros, origin=np.zeros(2), spacing=0.1, tops=zeros[:2])
    answer = worker.ask({"reader": "terrain.npz", "way": "given", "inputs": [(tmp_path / "a.npz").read_bytes().decode("latin-1")]}, 60.0)
    assert not answer.get("faults", answer), answer
    assert answer["refused"] == 1


def test_robots_times_frames_are_bounded(worker: Client, tmp_path: Path) -> None:
    """A file of 5 kB that asks for 100 robots in a million frames."""
    reader = READERS["results robots.csv"]
    reader.make(tmp_path)
    run = tmp_path / "r" / "run.json"
    run.write_text(run.read_text().replace('"frames": 3', '"frames": 1000000'))
    header, row, *_ = (tmp_path / reader.file).read_text().splitlines()
    (tmp_path / reader.file).write_text("\n".join([header, *(row.replace("robot_0", f"robot_{k}") for k in range(100))]))
    with pytest.raises(ValueError, match=r"robots.csv:35: 34 robots in 1000000 frames"):
        reader.read(tmp_path)

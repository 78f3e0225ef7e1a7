"""A real panoramic sequence (JRDB, bytes-cafe) from a table of its labels to files in JRDB's layout."""

from pathlib import Path

import numpy as np

from tracker.formats.jrdb.files import LABELS_2D, LABELS_3D, Label2d, Label3d, write_labels_2d, write_labels_3d

SEQUENCE = "bytes-cafe-2019-02-07_0"
WIDTH = 3760
ABOVE_FLOOR = 1.0


def write_cafe(table: Path, folder: Path) -> None:
    """Columns of the table: frame, id, cx, cy, h, w, l [m], rot_z [rad], left, top, width, height [px]."""
    labels_2d: dict[int, list[Label2d]] = {}
    labels_3d: dict[int, list[Label3d]] = {}
    for row in np.loadtxt(table, delimiter=","):
        frame, person, (cx, cy, h, w, length, heading), box = int(row[0]), int(row[1]), row[2:8], row[8:12]
        labels_2d.setdefault(frame, []).append(Label2d(person, box, box, 1.0))
        centre = np.array([cx, cy, h / 2 - ABOVE_FLOOR])
        labels_3d.setdefault(frame, []).append(Label3d(person, centre, np.array([length, w, h]), float(heading)))
    for name in (LABELS_2D, LABELS_3D):
        (folder / name).mkdir(parents=True)
    write_labels_2d(folder / LABELS_2D / f"{SEQUENCE}.json", labels_2d, WIDTH)
    write_labels_3d(folder / LABELS_3D / f"{SEQUENCE}.json", labels_3d)

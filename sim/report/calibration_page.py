"""The page of a calibration: parameters of each camera with deviations, undetermined parameters, and pictures before and after."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sim.report.findings import plural
from sim.report.page import PageMoment, PageTable, Picture, render
from tracker.calibration import Calibration
from tracker.calibration.body import FOCAL, HEIGHT, OFFSET, PITCH, ROLL, YAW, X, Y
from tracker.geometry.cameras import LensCamera
from tracker.io.atomic import write_text
from tracker.io.image_files import image_size

GLOSSARY = (
    ("±", "one standard deviation, from the curvature of the posterior density. Errors of detectors and of lenses are part of it."),
    ("Pitch, roll, yaw", "pitch is positive where the camera looks down, yaw is against the clock from the x axis."),
    ("Clock", "what is added to the times of a camera so that all have the times of the first one."),
    ("Feet from those of other cameras", "median distance on the ground between the feet that two cameras see of one person."),
)
ABOUT_PICTURES = "The plan, and the view of each camera in the frame with the most boxes: ground grid of 1 m or more, horizon, boxes and their feet."
FIGURES = {
    "boxes": ("boxes in the adjustment", "{:.0f}"),
    "people": ("tracks of people", "{:.0f}"),
    "inliers": ("share of the boxes that agree", "{:.3f}"),
    "mean_stature": ("mean stature", "{:.3f} m"),
}


def write_calibration_page(target: Path, found: Calibration, pictures: Mapping[str, tuple[str, bytes]], command: str) -> None:
    """Write the page. pictures: heading → the findings of `check` on that calibration, and its picture as bytes of a PNG file."""
    changes = [*(("Not known", line) for line in found.problems), *(("Changed", line) for line in found.changes)]
    names: dict[str, Any] = {
        "title": f"Calibration: {', '.join(found.cameras)}",
        "kicker": "pilsim calibrate",
        "heading": "Cameras calibrated by the people before them",
        "headline": _headline(found),
        "headings": {"moments": "Pictures"},
        "summary": [("What was found", _summary(found)), *changes],
        "about_moments": ABOUT_PICTURES,
        "moments": [_moment(heading, *of) for heading, of in pictures.items()],
        "tables": [("Cameras", [_cameras(found)]), ("Fit", [_fit(found)])],
        "glossary": GLOSSARY,
        "about_commands": "The same command makes the same calibration.",
        "commands": command,
        "made_by": "pilsim calibrate",
        "made_from": plural(len(found.cameras), "camera"),
    }
    write_text(target, render(names))


def _headline(found: Calibration) -> str:
    if found.problems:
        return f"The data do not say enough: {plural(len(found.problems), 'line')} below. This is the best guess."
    return f"{plural(len(found.cameras), 'camera')} on one ground."


def _summary(found: Calibration) -> str:
    sigma = np.array(list(found.sigma.values()))
    if not sigma.any():
        return "Nothing has moved beyond its errors: the cameras are as they were given."
    angle, place = np.degrees(sigma[:, [PITCH, ROLL, YAW]].max()), found.place_sigma.max()
    return f"Deviations are at most {sigma[:, FOCAL].max():.1%} of a focal length, {angle:.1f}° of an angle, {place:.2f} m of a place."


def _cell(value: float, sigma: float, form: str = ".2f") -> str:
    """A value with its deviation; alone where it was not estimated."""
    return f"{value:{form}} ± {sigma:{form}}" if sigma > 0 else f"{value:{form}}"


def _cameras(found: Calibration) -> PageTable:
    body = []
    for (name, camera), row, s in zip(found.cameras.items(), found.rows, found.sigma.values(), strict=True):
        lens = camera.camera
        focal = _cell(lens.fx, lens.fx * s[FOCAL], ".0f") if isinstance(lens, LensCamera) else "–"
        angles = (_cell(float(np.degrees(row[p])), float(np.degrees(s[p]))) for p in (PITCH, ROLL, YAW))
        high = float(np.exp(row[HEIGHT]))
        body.append(
            (name, focal, *angles, *(_cell(row[p], s[p]) for p in (X, Y)), _cell(high, high * s[HEIGHT]), _cell(row[OFFSET], s[OFFSET], ".3f"))
        )
    heads = ("focal length [px]", "pitch [°]", "roll [°]", "yaw [°]", "x [m]", "y [m]", "height [m]", "clock [s]")
    return PageTable("Parameters, those that were estimated with standard deviations", ("camera", *heads), tuple(body))


def _fit(found: Calibration) -> PageTable:
    body = ((words, form.format(found.figures[name])) for name, (words, form) in FIGURES.items() if name in found.figures)
    return PageTable("Figures of the adjustment", ("figure", "value"), tuple(body))


def _moment(heading: str, sentence: str, data: bytes) -> PageMoment:
    height, width = image_size(data) or (0, 0)
    return PageMoment(heading, sentence, (Picture(data, width, height, "png"),), (f"{heading}: plan and views of the cameras",), ())

"""A sequence and its exports, made once for all tests of this folder."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.tracker.formats import scene
from tracker.formats.exporting import export


@pytest.fixture(scope="session")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exports") / "plaza"
    scene.record(folder)
    return folder


@pytest.fixture(scope="session")
def exported(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Format → the folder of the sequence's export."""
    root = tmp_path_factory.mktemp("exported")

    def made(form: str) -> Path:
        if not (root / form).exists():
            export(sequence, form, root / form)
        return root / form

    return made


def pytest_itemcollected(item: pytest.Item) -> None:
    """Tests of exports need a sequence that is rendered."""
    if "sequence" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.render)

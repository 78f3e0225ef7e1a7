"""What tests share: where the real data lies."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

DATA = Path(os.environ.get("PILSIM_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Callable[..., Path]:
    """`data("pets2009", "calibration")` → that path in the folder of real data; the test is skipped where it is absent."""

    def find(*parts: str) -> Path:
        path = DATA.joinpath(*parts)
        if not path.exists():
            pytest.skip(f"real data not found: {path} (set PILSIM_DATA to the folder that holds it)")
        return path

    return find

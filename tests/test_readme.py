"""The README's commands and its Python run as they stand."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def pilsim_blocks() -> list[str]:
    return [block for block in blocks("sh") if "pilsim" in block and "pip install" not in block]


def test_there_is_something_to_test() -> None:
    assert len(pilsim_blocks()) == 5
    assert len(blocks("python")) == 1


@pytest.mark.parametrize("block", pilsim_blocks())
def test_commands(block: str, tmp_path: Path, data: Callable[..., Path]) -> None:
    environment = dict(os.environ, PATH=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if "$PETS" in block:
        environment["PETS"] = str(data("pets2009"))
    done = subprocess.run(["bash", "-euc", block], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr


def test_python(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", blocks("python")[0]], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "'mota'" in done.stdout


def test_pictures_are_there() -> None:
    for name in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (Path(__file__).parent.parent / name).stat().st_size > 10_000

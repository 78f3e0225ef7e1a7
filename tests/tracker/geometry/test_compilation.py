"""Compiled functions are cached where a cache can be written, and work where none can, or where it is damaged."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNEL = """
from tracker.geometry.compilation import njit

@njit(cache=True)
def double(x):
    return 2 * x

print(double(21))
"""
ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.command


def run(folder: Path, **environment: str) -> str:
    """What the kernel in `folder` prints, in a process of its own."""
    done = subprocess.run(
        [sys.executable, str(folder / "kernel.py")],
        env=dict(os.environ, PYTHONPATH=str(ROOT), **environment),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "kernel.py").write_text(KERNEL)
    return tmp_path / "code"


def test_the_cache_lies_beside_the_source(folder: Path) -> None:
    assert run(folder) == "42\n"
    assert list((folder / "__pycache__").glob("*.nbc"))


def test_a_truncated_cache_is_made_anew(folder: Path) -> None:
    assert run(folder) == "42\n"
    for suffix in ("nbi", "nbc"):
        (file,) = (folder / "__pycache__").glob(f"*.{suffix}")
        whole = file.read_bytes()
        file.write_bytes(whole[: len(whole) // 2])
        assert run(folder) == "42\n", suffix
        assert file.stat().st_size > len(whole) // 2, suffix


def test_long_compilation_is_said_once(folder: Path) -> None:
    (folder / "kernel.py").write_text("import tracker.geometry.compilation as c\nc.SILENT = 0.0\n" + KERNEL + "print(double(2.5))")
    words = run(folder)
    assert words.count("compiling for this machine") == 1
    # All is in the cache.
    assert run(folder) == "42\n5.0\n"


def test_without_any_folder_for_it_the_temporary_folder_has_the_cache(folder: Path, tmp_path: Path) -> None:
    """The cache beside the source and the home are files, so that no user, root included, can make a folder in them."""
    (folder / "__pycache__").write_text("")
    (tmp_path / "home").write_text("")
    (tmp_path / "temporary").mkdir()
    places = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "temporary")}
    assert run(folder, **places) == "42\n"
    assert list((tmp_path / "temporary").rglob("*.nbc"))


OTHER = """
from tracker.geometry.compilation import njit

COUNT = {count}

@njit(cache=True)
def times(x):
    return {factor} * x
"""
CALLER = """
from {module} import COUNT, {kernel}
from tracker.geometry.compilation import njit

@njit(cache=True)
def {name}(x):
    return {kernel}(x) + COUNT
"""


def test_a_change_in_an_imported_kernel_or_number_is_noticed(folder: Path) -> None:
    """Also through a file between them."""
    (folder / "middle.py").write_text(CALLER.format(module="other", kernel="times", name="middle"))
    (folder / "kernel.py").write_text(CALLER.format(module="middle", kernel="middle", name="last") + "print(last(21))\n")
    for factor, count, result in ((2, 0, "42\n"), (20, 0, "420\n"), (20, 3, "426\n")):
        (folder / "other.py").write_text(OTHER.format(factor=factor, count=count))
        assert run(folder) == result
        assert run(folder) == result


HELPED = """
from other import COUNT
from tracker.geometry.compilation import njit

@njit(cache=True)
def last(x):
    return helper(x)

@njit(cache=True)
def helper(x):
    return x + COUNT

print(last(21))
"""


def test_a_change_in_a_number_that_a_kernel_below_uses_is_noticed(folder: Path) -> None:
    (folder / "kernel.py").write_text(HELPED)
    for count, result in ((0, "21\n"), (33, "54\n")):
        (folder / "other.py").write_text(f"COUNT = {count}\n")
        assert run(folder) == result


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="needs root to give a folder to another user")
def test_a_folder_of_another_user_is_no_cache(folder: Path, tmp_path: Path) -> None:
    (folder / "__pycache__").write_text("")
    (tmp_path / "home").write_text("")
    strange = tmp_path / "temporary" / f"pilsim-numba-{os.getuid()}"
    strange.mkdir(parents=True)
    os.chown(strange, 12345, 12345)
    places = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "temporary")}
    assert run(folder, **places) == "42\n"
    assert not list(strange.rglob("*"))

"""The wheel, as it is used in containers: in a virtual environment that the user may not write, under another uid, with a read-only HOME."""

import os
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
UID = 54321
OPEN = """
set -e
# The interpreter may lie in a folder that others cannot enter, as /root: it is laid bare in a namespace of mounts of this process alone.
if ! setpriv --reuid {uid} --regid {uid} --clear-groups test -x {base}/bin; then
    mkdir {room}/base
    mount --bind {base} {room}/base
    mount -t tmpfs -o mode=755 none {top}
    mkdir -p {base}
    mount --bind {room}/base {base}
fi
cd {room}/work
exec setpriv --reuid {uid} --regid {uid} --clear-groups env -i PATH=/usr/bin:/bin HOME={room}/home {python} -m pilsim "$@"
"""
COMMANDS = (
    "--version",
    "demo --frames 4 --people 3 --robots 2 --width 256 --out demo",
    "score demo/sequence demo/track --json",
    "check demo/sequence",
    "clique a.clq --seconds 0.1",
    "worlds tunnel --export tunnel.glb",
    "stress --sweep density/1 --frames 4 --width 128 --no-render --out stress",
    "report stress",
    "doctor",
)


@pytest.fixture(scope="module")
def room() -> Iterator[Path]:
    """A folder with `env`, where the wheel is installed, an empty `home`, and `work`, which alone belongs to the user."""
    if os.name != "posix" or os.geteuid() != 0 or not shutil.which("setpriv") or not shutil.which("unshare"):
        pytest.skip("needs root, setpriv and unshare (util-linux) to work under another uid")
    # Folders of pytest are closed to others.
    room = Path(tempfile.mkdtemp(prefix="pilsim-wheel-"))
    try:
        room.chmod(0o755)
        _install(_wheel(room), room / "env")
        for name in ("home", "work"):
            (room / name).mkdir(mode=0o755)
        os.chown(room / "work", UID, UID)
        (room / "work" / "a.clq").write_text("p edge 3 2\ne 1 2\ne 2 3\n")
        yield room
    finally:
        shutil.rmtree(room)
        shutil.rmtree(Path(tempfile.gettempdir(), f"pilsim-numba-{UID}"), ignore_errors=True)


def _wheel(room: Path) -> Path:
    """A wheel that is built from a copy of the sources."""
    sources = room / "sources"
    sources.mkdir()
    for house in ("sim", "tracker", "worlds"):
        shutil.copytree(ROOT / house, sources / house, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pilsim.py", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources / name)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check", "--no-deps", "-w", str(room), str(sources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "No matching distribution" in done.stderr or "connection" in done.stderr.lower():
        pytest.skip("needs setuptools from a package index to build a wheel")
    assert done.returncode == 0, done.stderr
    (wheel,) = room.glob("pilsim-*.whl")
    return wheel


def _install(wheel: Path, folder: Path) -> None:
    """Install the wheel alone. Its dependencies are taken from the environment of the tests."""
    venv.create(folder, with_pip=False)
    (site,) = folder.glob("lib/python*/site-packages")
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--target", str(site), str(wheel)],
        check=True,
    )
    (dependencies,) = Path(sys.prefix).glob("lib/python*/site-packages")
    (site / "dependencies.pth").write_text(f"{dependencies}\n")
    for path in site.rglob("*"):
        path.chmod(path.stat().st_mode & ~0o222)


@pytest.mark.soak
def test_all_works_where_little_may_be_written(room: Path) -> None:
    base = Path(sys.base_prefix).resolve()
    script = OPEN.format(uid=UID, base=base, top=f"/{base.parts[1]}", room=room, python=room / "env" / "bin" / "python")
    for words in COMMANDS:
        done = subprocess.run(["unshare", "-m", "bash", "-c", script, "sh", *words.split()], capture_output=True, text=True, check=False)
        if (room / "base").exists():
            (room / "base").rmdir()  # An empty folder here, since the mount was the process's own.
        if "unshare" in done.stderr or "mount:" in done.stderr:
            pytest.skip(f"needs the right to mount: {done.stderr.strip()}")
        assert done.returncode == 0, f"{words}: {done.stderr}"
        assert "Warning" not in done.stderr, f"{words}: {done.stderr}"
    assert (room / "work" / "demo" / "video.mp4").exists()
    assert not list((room / "home").iterdir())

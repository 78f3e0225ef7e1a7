"""Standard streams that are closed, full, or lack characters end no work."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

GRAPH = "p edge 3 2\ne 1 2\ne 2 3\n"


def shell(command: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """A command line of the shell in `folder`; PILSIM stands for the program."""
    text = command.replace("PILSIM", f"{sys.executable} -m pilsim")
    root = str(Path(__file__).parents[3])
    return subprocess.run(
        ["bash", "-c", text], cwd=folder, env=dict(os.environ, PYTHONPATH=root, **environment), capture_output=True, check=False, timeout=120
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.clq").write_text(GRAPH)
    return tmp_path


@pytest.mark.command
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams(folder: Path, closed: str) -> None:
    done = shell(f"PILSIM clique a.clq --seconds 0.1 --json {closed}", folder)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr


@pytest.mark.command
def test_characters_that_a_stream_lacks_are_replaced(folder: Path) -> None:
    for words, code in (("track --help", 0), ("stress --help", 0), ("track x --hypothésis y --out z", 2)):
        done = shell(f"PILSIM {words}", folder, PYTHONIOENCODING="iso-8859-1")
        assert done.returncode == code, done.stderr
        assert b"codec" not in done.stderr


LOCALES = {"tr_TR": "ISO-8859-9"}
NO_UTF8 = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.fixture(scope="module")
def locales(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """The environment of each locale: ASCII, and one that localedef makes."""
    if not shutil.which("localedef"):
        pytest.skip("needs localedef (Debian: locales) to make locales that are not UTF-8")
    out, folder = {"C": NO_UTF8}, tmp_path_factory.mktemp("locales")
    for name, charmap in LOCALES.items():
        done = subprocess.run(["localedef", "-i", name, "-f", charmap, str(folder / f"{name}.{charmap}")], capture_output=True, check=False)
        if done.returncode:
            pytest.skip(f"needs the sources of locales (Debian: locales): {done.stderr.decode(errors='replace').strip()}")
        out[name] = {"LOCPATH": str(folder), "LC_ALL": f"{name}.{charmap}"}
    return out


@pytest.mark.command
@pytest.mark.parametrize("name", ["C", *LOCALES])
def test_locales_that_are_not_utf8(folder: Path, locales: dict[str, dict[str, str]], name: str) -> None:
    (folder / "häßlich.clq").write_text(GRAPH)
    for words, code, said in (
        ("--help", 0, b"usage: pilsim"),
        ("track --help", 0, b"--n-scan"),
        ("clique häßlich.clq --seconds 0.1", 0, b"a clique of weight"),
        ("clique häßlich.clq --secondsé 1", 2, b"did you mean --seconds?"),
        ("clique nöthing.clq", 2, b"thing.clq: No such file or directory"),
    ):
        done = shell(f"PILSIM {words}", folder, **locales[name])
        assert done.returncode == code, done.stderr
        assert said in done.stdout + done.stderr
        assert b"codec" not in done.stderr


@pytest.mark.command
def test_files_are_written_under_names_that_a_locale_lacks_though_standard_error_is_full(folder: Path, locales: dict[str, dict[str, str]]) -> None:
    done = shell("PILSIM worlds tunnel --export ö/ä.glb 2> /dev/full", folder, **locales["C"])
    assert done.returncode == 0
    assert (folder / "ö" / "ä.glb").stat().st_size > 1000


@pytest.mark.command
@pytest.mark.parametrize("words", ["--help", "track --help", "clique a.clq --seconds 0.1 --json"])
def test_streams_of_every_kind_of_output(folder: Path, words: str) -> None:
    full = shell(f"PILSIM {words} > /dev/full", folder)
    assert (full.returncode, full.stderr) == (2, b"error: standard output: No space left on device\n")
    assert shell(f"PILSIM {words} 2> /dev/full", folder).returncode == 0
    for reader in ("true", "head -1"):
        cut = shell(f"set -o pipefail; PILSIM {words} | {reader}", folder)
        assert cut.returncode in (0, 1)
        assert cut.stderr == b""


@pytest.mark.command
@pytest.mark.parametrize("words", ["nonsense", "clique none.clq"])
def test_errors_where_streams_fail(folder: Path, words: str) -> None:
    for streams in ("> /dev/full", "2> /dev/full", ">&- 2>&-", "| true"):
        done = shell(f"set -o pipefail; PILSIM {words} {streams}", folder)
        assert done.returncode == 2, (streams, done.stderr)
        assert done.stderr.count(b"\n") == (0 if "2>" in streams else 1)

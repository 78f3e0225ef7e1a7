"""Every module can be imported where parts of POSIX are missing, as on Windows and macOS. The systems themselves are not tried here."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
OPTIONAL = {"stable_baselines3", "torch", "rerun", "distributed", "pettingzoo"}
"""Packages of extras: a module that needs one says so by its ImportError."""
WITHOUT = {
    "windows": (
        ["fcntl", "resource", "pwd", "grp", "termios", "pty", "tty", "readline", "syslog", "curses", "_curses"],
        [
            "sched_getaffinity", "sched_setaffinity", "O_DIRECTORY", "O_NOFOLLOW", "O_CLOEXEC", "O_PATH", "O_NONBLOCK", "geteuid", "getuid", "getgid",
            "getegid", "fork", "forkpty", "killpg", "setsid", "setpgid", "getpgid", "mkfifo", "mknod", "chown", "lchown", "fchown", "fchmod",
            "chroot", "statvfs", "fstatvfs", "uname", "nice", "sysconf", "getloadavg", "pread", "pwrite", "sendfile", "sync", "wait3", "wait4",
        ],
        ["SIGKILL", "SIGALRM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGCHLD", "SIGPIPE", "setitimer", "alarm", "pthread_sigmask", "pause"],
    ),
    "macos": ([], ["sched_getaffinity", "sched_setaffinity", "O_PATH", "posix_fadvise", "memfd_create", "getrandom", "pidfd_open"], []),
}  # fmt: skip
"""System → modules, attributes of os and attributes of signal that it lacks."""
IMPORT_ALL = """
import os, sys
sys.path.insert(0, {root!r})
# Packages of others keep what they find on this system: only modules of pilsim are tried.
import cv2, defusedxml.ElementTree, filelock, gymnasium, jinja2, joblib, matplotlib.figure, mujoco, numba, scipy.stats, tqdm, trimesh, tyro, OpenGL.GL
import asyncio, concurrent.futures.process, ctypes.util, multiprocessing.pool, scipy.optimize, scipy.ndimage, scipy.sparse.csgraph, scipy.spatial
import scipy.interpolate, scipy.signal, scipy.special, xml.etree.ElementTree, zipfile, uuid, http.server, signal
from joblib.externals.loky import get_reusable_executor
for name in {optional!r}:
    try:
        __import__(name)
    except ImportError:
        pass
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name in {modules!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked())
for name in {modules!r}:
    sys.modules.pop(name, None)
for name in {of_os!r}:
    if hasattr(os, name):
        delattr(os, name)
for name in {of_signal!r}:
    if hasattr(signal, name):
        delattr(signal, name)
import importlib
failed = []
for name in {names!r}:
    try:
        importlib.import_module(name)
    except ImportError as error:
        if (error.name or "").split(".")[0] not in {optional!r}:
            failed.append(f"{{name}}: {{error!r}}")
    except Exception as error:
        failed.append(f"{{name}}: {{error!r}}")
print(*failed, sep="\\n")
"""


def modules() -> list[str]:
    paths = [path for house in ("sim", "tracker", "worlds") for path in sorted((ROOT / house).rglob("*.py"))]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in paths]
    return ["pilsim", *(name for name in names if not name.endswith("__main__"))]


@pytest.mark.command
@pytest.mark.parametrize("system", ["windows", "macos"])
def test_every_module_is_imported_without_what_a_system_lacks(system: str) -> None:
    missing, of_os, of_signal = WITHOUT[system]
    program = IMPORT_ALL.format(root=str(ROOT), optional=OPTIONAL, modules=set(missing), of_os=of_os, of_signal=of_signal, names=modules())
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stdout + done.stderr

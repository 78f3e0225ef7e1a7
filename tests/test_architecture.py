"""The structure of the project: who may import whom, how large folders and files may grow, and what every package says of itself."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
HOUSES = ("worlds", "tracker", "sim")
TOP = {*HOUSES, "tests", ".ci"}
FORBIDDEN = {"worlds": {"sim", "tracker"}, "tracker": {"sim", "worlds", "mujoco", "gymnasium"}, "sim": {"tests"}}
MOST_FILES, MOST_COMMANDS, MOST_LINES = 15, 30, 600
"""Files of a folder beside `__init__.py`; the same of `sim/cli`; lines of a file."""

LAYERS: dict[str, dict[str, set[str]]] = {
    "worlds": {
        "engine": set(),
        "attachment": {"engine"},
        "terrain": {"engine"},
        "textures": {"engine", "terrain"},
        "props": {"engine", "terrain", "textures"},
        "world": {"engine", "terrain"},
        "triangles": {"engine", "world", "terrain"},
        "scenes": {"engine", "terrain", "textures", "props", "world"},
        "semantics": set(),
        "places": {"engine", "attachment", "terrain", "textures", "world", "triangles", "semantics"},
        "catalogue": {"scenes", "places", "world"},
        "export": {"engine", "semantics", "terrain", "textures", "triangles", "world"},
        "difficulty": {"terrain", "triangles", "world"},
    },
    "tracker": {
        "geometry": set(),
        "types": {"geometry"},
        "io": {"geometry"},
        "clique": {"geometry", "io"},
        "ekf": {"geometry", "types"},
        "detections": {"geometry", "types"},
        "reading_ahead": set(),
        "person_detector": {"reading_ahead", "geometry", "types", "io", "detections"},
        "sequence": {"geometry", "types", "io"},
        "slam": {"geometry", "types", "ekf"},
        "tracks": {"geometry", "types", "detections"},
        "mht": {"geometry", "types", "detections", "tracks", "clique"},
        "planar_slam": {"geometry", "io", "sequence"},
        "recordings": {"geometry", "types", "io", "sequence", "detections"},
        "calibration": {"geometry", "recordings"},
        "datasets": {"geometry", "types", "io", "sequence", "detections", "ekf", "recordings"},
        "formats": {"geometry", "types", "io", "sequence", "detections", "planar_slam", "recordings"},
        "detector_models": {"geometry", "types", "io", "detections", "recordings", "formats"},
        "metrics": {"geometry", "types", "io", "sequence", "ekf", "slam", "recordings", "formats", "detector_models"},
        "pipeline": {"reading_ahead", "geometry", "types", "detections", "tracks", "mht", "slam"},
        "parameter_file": {"io"},
        "options": {"parameter_file", "pipeline", "types", "detections", "tracks", "mht", "slam", "ekf"},
        "run": {"pipeline", "types", "io", "sequence"},
    },
    "sim": {
        "robots": set(),
        "cameras": set(),
        "effects": set(),
        "scenario": {"robots", "cameras", "effects"},
        "confidence_intervals": set(),
        "rendering": set(),
        "pedestrian": set(),
        "parallel": set(),
        "crowd": {"pedestrian"},
        "simulation": {"pedestrian", "crowd", "robots", "scenario"},
        "sensors": {"pedestrian", "rendering", "robots", "simulation", "scenario"},
        "visualization": {"simulation", "rendering", "scenario"},
        "recording": {"sensors", "simulation", "rendering", "pedestrian", "scenario", "cameras", "effects", "parallel"},
        "placement": {"recording", "sensors", "simulation", "crowd", "robots", "pedestrian", "rendering", "scenario", "parallel"},
        "datasets": {"recording", "simulation", "crowd", "robots", "pedestrian", "parallel", "visualization", "scenario"},
        "training": {"datasets", "sensors", "simulation", "rendering", "parallel", "scenario"},
        "policies": {"placement", "simulation", "robots", "parallel", "scenario", "confidence_intervals"},
        "stress": {"policies", "datasets", "recording", "sensors", "visualization", "parallel", "scenario"},
        "prediction": {"stress", "datasets", "recording", "parallel", "confidence_intervals"},
        "tuning": {"stress", "prediction", "parallel", "confidence_intervals"},
        "report": {"stress", "prediction", "tuning", "confidence_intervals", "placement", "policies"},
        "studies": {"recording", "stress", "scenario"},
        "cli": {
            "scenario", "confidence_intervals", "cameras", "effects", "rendering", "pedestrian", "robots", "parallel", "crowd", "simulation",
            "sensors", "visualization", "recording", "placement", "datasets", "training", "policies", "stress", "prediction", "tuning", "report",
            "studies",
        },
    },
}  # fmt: skip
"""House → package, or file beside the packages → the packages of its house that it may import. The order is from the bottom up."""
ONLY_CLI = {"tracker.formats.exporting", "tracker.planar_slam"}
"""What of `tracker` the command line alone may import, not the rest of `sim`."""


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def sources(house: str) -> list[Path]:
    files = sorted((ROOT / house).rglob("*.py"))
    assert files
    return files


def imported(path: Path) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Modules that a file imports anywhere in it, each with the names that it takes of them."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}:{node.lineno}: a relative import"
            yield node.module or "", tuple(alias.name for alias in node.names)


def tops(path: Path) -> set[str]:
    return {module.split(".")[0] for module, _ in imported(path)}


def package_of(path: Path) -> str:
    """The package of its house that a file is in; the file's own name where it stands beside the packages."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[1]


def within(house: str, path: Path) -> Iterator[str]:
    """The packages (or files beside them) of the house that a file imports."""
    for module, names in imported(path):
        parts = module.split(".")
        if parts[0] == house:
            yield from (parts[1],) if len(parts) > 1 else names


@pytest.mark.parametrize("house", HOUSES)
def test_houses_import_one_way(house: str) -> None:
    for path in sources(house):
        assert not tops(path) & FORBIDDEN[house], path


@pytest.mark.parametrize("house", HOUSES)
def test_packages_import_only_what_their_layer_allows(house: str) -> None:
    layers = LAYERS[house]
    for path in sources(house):
        name = package_of(path)
        if name == "__init__":
            continue
        assert name in layers, f"{path}: {name} is in no layer"
        above = {other for other in within(house, path) if other != name} - layers[name]
        assert not above, f"{path} imports {sorted(above)}"


@pytest.mark.parametrize("house", HOUSES)
def test_layers_point_down(house: str) -> None:
    """The list itself has no circle: each entry names only entries that stand above it."""
    before: set[str] = set()
    for name, below in LAYERS[house].items():
        assert below <= before, f"{house}/{name} may import {sorted(below - before)}, which stand below it in the list"
        before.add(name)


def test_what_only_the_command_line_may_import() -> None:
    for path in sources("sim"):
        if package_of(path) != "cli":
            taken = {module for module, _ in imported(path)}
            assert not [module for module in taken if any(f"{module}.".startswith(f"{only}.") for only in ONLY_CLI)], path


def graph(house: str) -> dict[str, set[str]]:
    """Module → the modules of its house that it imports, by type checkers' imports, too; a package stands for its `__init__.py`."""
    names = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in sources(house)}
    out: dict[str, set[str]] = {}
    for name, path in names.items():
        found: set[str] = set()
        for module, taken in imported(path):
            if module in names:
                found |= {f"{module}.{one}" if f"{module}.{one}" in names else module for one in taken} or {module}
        out[name] = found - {name}
    return out


@pytest.mark.parametrize("house", HOUSES)
def test_no_circles(house: str) -> None:
    edges, state, trail = graph(house), dict[str, int](), list[str]()

    def visit(module: str) -> None:
        state[module] = 1
        trail.append(module)
        for other in sorted(edges[module]):
            assert state.get(other) != 1, f"a circle: {' -> '.join([*trail[trail.index(other) :], other])}"
            if other not in state:
                visit(other)
        trail.pop()
        state[module] = 2

    for module in edges:
        if module not in state:
            visit(module)


@pytest.mark.parametrize("house", HOUSES)
def test_folders_stay_small(house: str) -> None:
    count = Counter(path.parent.relative_to(ROOT).as_posix() for path in sources(house) if path.name != "__init__.py")
    for folder, files in count.items():
        assert files <= (MOST_COMMANDS if folder == "sim/cli" else MOST_FILES), f"{folder} has {files} files"


@pytest.mark.parametrize("house", HOUSES)
def test_files_stay_small_and_are_named_after_things(house: str) -> None:
    for path in sources(house):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES, path
        assert path.stem not in {"utils", "util", "helpers", "common", "base", "misc", "manager", "core"}, path


@pytest.mark.parametrize("house", HOUSES)
def test_no_class_name_stands_twice(house: str) -> None:
    where = defaultdict(list)
    for path in sources(house):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ClassDef):
                where[node.name].append(path.relative_to(ROOT).as_posix())
    twice = {name: files for name, files in where.items() if len(files) > 1}
    assert not twice


@pytest.mark.parametrize("house", HOUSES)
def test_every_package_says_what_it_is_for(house: str) -> None:
    """Two sentences: what the package is for, and which of its files to read first; that file is there."""
    for path in sources(house):
        if path.name != "__init__.py":
            continue
        said = " ".join((ast.get_docstring(parsed(path)) or "").split())
        sentences = re.findall(r"[^.!?]+(?:\.(?!\s|$)[^.!?]*)*[.!?](?=\s|$)", said)
        assert len(sentences) >= 2, f"{path}: needs two sentences"
        named = re.findall(r"[Rr]ead `([\w/]+\.py)` first", said)
        assert named, f"{path}: says no file to read first"
        assert (path.parent / named[0]).is_file(), f"{path}: {named[0]} is not there"


@pytest.mark.parametrize("house", HOUSES)
def test_packages_only_hand_on_names(house: str) -> None:
    """`__init__.py` has a docstring, imports and `__all__`, and no other work; `import sim` alone registers the environment."""
    for path in sources(house):
        if path.name != "__init__.py" or path == ROOT / "sim" / "__init__.py":
            continue
        for node in parsed(path).body:
            docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            names = isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__"
            assert docstring or names or isinstance(node, ast.ImportFrom), f"{path}:{node.lineno}"


def compiled(tree: ast.Module) -> dict[str, ast.FunctionDef]:
    """Functions that numba compiles, by name."""
    return {
        node.name: node
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and any("jit" in ast.unparse(decorator) for decorator in node.decorator_list)
    }


@pytest.mark.parametrize("house", HOUSES)
def test_compiled_functions_name_what_they_call_of_other_files(house: str) -> None:
    """The cache notices a change in kernels and numbers that a file imports by name (tracker/geometry/compilation.py), not in those of a module."""
    for path in sources(house):
        tree = parsed(path)
        imported = {alias.asname or alias.name for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom)) for alias in node.names}
        for name, function in compiled(tree).items():
            bases = {node.value.id for node in ast.walk(function) if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)}
            assert bases & imported <= {"np", "math"}, f"{path}: {name} uses {sorted(bases & imported)}, needs their functions by name"


def test_only_the_renderer_knows_gl_and_only_the_simulation_steps() -> None:
    for path in sources("sim"):
        text = path.read_text(encoding="utf-8")
        if path.name not in ("gl_context.py", "gl_objects.py", "opengl_renderer.py"):
            assert "OpenGL" not in tops(path), path
            assert "mjr_" not in text, path
        if path.name != "simulation.py":
            assert "mj_step(" not in text, path


@pytest.mark.command
def test_tracker_runs_without_mujoco() -> None:
    names = ", ".join(".".join(path.relative_to(ROOT).with_suffix("").parts) for path in sources("tracker") if path.name != "__init__.py")
    block = f"import sys; sys.modules['mujoco'] = None; import {names}"
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.command
def test_importing_a_house_needs_neither_plots_nor_videos_nor_bags() -> None:
    """`import sim` registers the environment of gymnasium; the tracker's pipeline is what a user's program imports."""
    code = "import sys, sim, tracker.pipeline, worlds.catalogue; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert not {"matplotlib", "av", "mcap", "rosbags", "torch", "tyro"} & set(done.stdout.split())


@pytest.mark.command
def test_folders_at_the_top() -> None:
    tracked = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=True).stdout.split()
    assert {name.split("/")[0] for name in tracked if "/" in name} <= TOP
    assert not [name for name in tracked if "/" not in name and name.endswith((".png", ".jpg"))]


def test_tests_mirror_the_packages() -> None:
    for house in HOUSES:
        folders = {path.parent.relative_to(ROOT / house) for path in sources(house)}
        for path in (ROOT / "tests" / house).rglob("test_*.py"):
            assert path.parent.relative_to(ROOT / "tests" / house) in folders, path

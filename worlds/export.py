"""Export of a world: a MuJoCo model with its files, or textured triangles for other programs."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from worlds.engine import mujoco
from worlds.terrain.heightfield import Array
from worlds.triangles import scenery
from worlds.world import World

_ASSETS = "assets"


def export(world: World, path: Path) -> None:
    """Write the scene of a world, without people and robots, to `path`. The ending of the name chooses the format:

    * .xml: MJCF, with textures, meshes and the height field in a folder `NAME_assets` beside it.
    * .mjz: the same as one archive of MuJoCo.
    * .glb and .obj (with .mtl and .png beside it): textured triangles.
    * .ply: triangles with a colour at each vertex.

    Units are metres, z is up (y in glTF). Nothing half-written is left under that name. Raises ValueError for another ending.
    """
    forms: dict[str, Callable[[World, Path], None]] = {".xml": _xml, ".mjz": _mjz, ".glb": _triangles, ".obj": _obj, ".ply": _triangles}
    if path.suffix not in forms:
        raise ValueError(f"export file is {path.name!r}, needs an ending of {', '.join(forms)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    forms[path.suffix](world, path)


def _xml(world: World, path: Path) -> None:
    folder = f"{path.stem}_{_ASSETS}"
    text, files = _mjcf(world, folder)
    (path.parent / folder).mkdir(exist_ok=True)
    for name, content in files.items():
        _write(path.parent / folder / name, content)
    _write(path, text.encode())


def _mjz(world: World, path: Path) -> None:
    text, files = _mjcf(world, _ASSETS)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in {"model.xml": text.encode(), **{f"{_ASSETS}/{name}": content for name, content in files.items()}}.items():
            # A fixed date: the same world gives the same bytes.
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    _write(path, buffer.getvalue())


def _triangles(world: World, path: Path) -> None:
    scene = scenery(world.spec)
    form = path.suffix[1:]
    content = scene.export(file_type="glb") if form == "glb" else scene.to_mesh().export(file_type="ply")
    _write(path, content)


def _obj(world: World, path: Path) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        scenery(world.spec).export(Path(folder) / path.name, mtl_name=f"{path.stem}.mtl")
        materials, others = Path(folder, f"{path.stem}.mtl"), {path.name, f"{path.stem}.mtl"}
        # Textures are named after the export, so that two exports in one folder do not share them.
        names = {made.name: f"{path.stem}_{made.name}" for made in Path(folder).iterdir() if made.name not in others}
        lines = [line.split(" ") for line in materials.read_text(encoding="utf-8").split("\n")]
        _write(materials, "\n".join(" ".join([*words[:-1], names.get(words[-1], words[-1])]) for words in lines))
        for made in sorted(Path(folder).iterdir(), key=lambda file: file.name == path.name):
            made.replace(path.parent / names.get(made.name, made.name))


def _mjcf(world: World, folder: str) -> tuple[str, dict[str, bytes]]:
    """The model's XML, and the files that it reads from `folder`, by name: MuJoCo cannot write buffers into XML."""
    spec = world.spec.copy()
    files = {}
    for texture in spec.textures:
        if texture.builtin == mujoco.mjtBuiltin.mjBUILTIN_NONE and texture.data:
            files[f"{texture.name}.png"] = _png(texture)
            texture.data = b""
            texture.file = f"{folder}/{texture.name}.png"
    for mesh in spec.meshes:
        files[f"{mesh.name}.obj"] = _wavefront(mesh)
        mesh.uservert = mesh.userface = mesh.usertexcoord = mesh.usernormal = []
        mesh.file = f"{folder}/{mesh.name}.obj"
    for field in spec.hfields:
        heights = np.array(field.userdata, dtype=np.float32)
        files[f"{field.name}.hf"] = np.array([field.nrow, field.ncol], dtype=np.int32).tobytes() + heights.tobytes()
        field.userdata = []
        field.file = f"{folder}/{field.name}.hf"
        field.content_type = "image/vnd.mujoco.hfield"
    # It looks into the files while it writes their names.
    spec.assets = {f"{folder}/{name}": content for name, content in files.items()}
    return spec.to_xml(), files


def _png(texture: mujoco.MjsTexture) -> bytes:
    pixels = np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, texture.nchannel)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def _wavefront(mesh: mujoco.MjsMesh) -> bytes:
    """An OBJ file with the very numbers of a mesh that was given as arrays."""
    vertices = np.array(mesh.uservert, dtype=np.float32).reshape(-1, 3)
    faces = np.array(mesh.userface, dtype=np.int64).reshape(-1, 3) + 1
    texcoord = np.array(mesh.usertexcoord, dtype=np.float32).reshape(-1, 2)
    lines = ["v " + " ".join(map(_decimal, row)) for row in vertices]
    if len(texcoord):
        # OBJ counts v upwards in the picture.
        lines += ["vt " + " ".join(map(_decimal, (u, np.float32(1) - v))) for u, v in texcoord]
        lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in faces]
    else:
        lines += ["f " + " ".join(map(str, face)) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def _decimal(value: Array) -> str:
    return np.format_float_positional(np.float32(value), trim="0")


def _write(path: Path, content: bytes | str) -> None:
    part = path.with_name(path.name + ".part")
    part.write_bytes(content.encode() if isinstance(content, str) else content)
    part.replace(path)

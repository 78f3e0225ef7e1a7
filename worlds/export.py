"""Export of a world: a MuJoCo model with its files, or textured triangles for other programs."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from worlds.engine import mujoco
from worlds.terrain.heightfield import Array
from worlds.triangles import compiled_mesh, compiled_picture, scenery
from worlds.world import World

_ASSETS = "assets"


def export(world: World, path: Path) -> None:
    """Write the scene of a world, without people and robots, to `path`. The ending of the name chooses the format:

    * .xml: MJCF, with textures, meshes and the height field in a folder `NAME_assets` beside it.
    * .mjz: the same as one archive of MuJoCo.
    * .glb and .obj (with .mtl and .png beside it): textured triangles.
    * .ply: triangles with a colour at each vertex.

    Units are metres, z is up (y in glTF). No incomplete file is left under that name. Raises ValueError for another ending.
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
            # With a fixed date, the same world gives the same bytes.
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
        if materials.is_file():  # There is none where nothing has a texture.
            lines = [line.split(" ") for line in materials.read_text(encoding="utf-8").split("\n")]
            _write(materials, "\n".join(" ".join([*words[:-1], names.get(words[-1], words[-1])]) for words in lines))
        for made in sorted(Path(folder).iterdir(), key=lambda file: file.name == path.name):
            made.replace(path.parent / names.get(made.name, made.name))


def _mjcf(world: World, folder: str) -> tuple[str, dict[str, bytes]]:
    """The model's XML, and the files that it reads from `folder`, by name: MuJoCo cannot write buffers into XML.

    Assets that a user's model reads from files are written as they were compiled, so that the export needs none of these files.
    """
    spec = world.spec.copy()
    model = world.spec.copy().compile() if any(one.file for of in (spec.meshes, spec.textures, spec.hfields) for one in of) else None
    files = {}

    def stored(name: str, content: bytes) -> str:
        # Names of attached parts have slashes, which would be folders.
        files[name.replace("/", "-")] = content
        return f"{folder}/{name.replace('/', '-')}"

    for texture in spec.textures:
        if model is not None and (texture.file or any(texture.cubefiles)):
            texture.file = stored(f"{texture.name}.png", _png(compiled_picture(model, model.texture(texture.name).id)))
            texture.cubefiles, texture.vflip, texture.hflip, texture.content_type = [""] * 6, 0, 0, "image/png"
            if texture.type != mujoco.mjtTexture.mjTEXTURE_2D:
                texture.gridsize, texture.gridlayout = [6, 1], "RLUDFB"
        elif texture.builtin == mujoco.mjtBuiltin.mjBUILTIN_NONE and texture.data:
            content = _png(np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, texture.nchannel))
            texture.data, texture.file = b"", stored(f"{texture.name}.png", content)
    for mesh in spec.meshes:
        content = _wavefront(mesh) if model is None or not mesh.file else _compiled_wavefront(model, mesh)
        mesh.uservert = mesh.userface = mesh.usertexcoord = mesh.usernormal = []
        mesh.file, mesh.content_type = stored(f"{mesh.name}.obj", content), ""
    for field in spec.hfields:
        heights = np.array(field.userdata, dtype=np.float32)
        if model is not None and field.file:
            compiled = model.hfield(field.name)
            field.nrow, field.ncol, heights = int(compiled.nrow[0]), int(compiled.ncol[0]), compiled.data.ravel().astype(np.float32)
        content = np.array([field.nrow, field.ncol], dtype=np.int32).tobytes() + heights.tobytes()
        field.userdata, field.file, field.content_type = [], stored(f"{field.name}.hf", content), "image/vnd.mujoco.hfield"
    # to_xml reads the files while it writes their names.
    spec.assets = {f"{folder}/{name}": content for name, content in files.items()}
    return spec.to_xml(), files


def _png(pixels: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels.squeeze()).save(buffer, "PNG")
    return buffer.getvalue()


def _compiled_wavefront(model: mujoco.MjModel, mesh: mujoco.MjsMesh) -> bytes:
    """An OBJ file of a mesh that a model reads from a file. Its scale and reference frame are in the vertices, and are taken from `mesh`."""
    number, turn = model.mesh(mesh.name).id, np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.mesh_quat[number])
    made = compiled_mesh(model, number)
    vertices = np.asarray(made.vertices) @ turn.reshape(3, 3).T + model.mesh_pos[number]
    mesh.scale, mesh.refpos, mesh.refquat = [1, 1, 1], [0, 0, 0], [1, 0, 0, 0]
    return _obj_text(vertices, np.asarray(made.faces), made.metadata.get("uv"))


def _wavefront(mesh: mujoco.MjsMesh) -> bytes:
    """An OBJ file with the exact float32 values of a mesh that was given as arrays."""
    texcoord = np.array(mesh.usertexcoord, dtype=np.float32).reshape(-1, 2)
    # OBJ counts v upwards in the picture.
    uv = np.column_stack([texcoord[:, 0], np.float32(1) - texcoord[:, 1]]) if len(texcoord) else None
    return _obj_text(np.array(mesh.uservert, dtype=np.float32).reshape(-1, 3), np.array(mesh.userface, dtype=np.int64).reshape(-1, 3), uv)


def _obj_text(vertices: NDArray[np.floating], faces: NDArray[np.int64], uv: NDArray[np.floating] | None) -> bytes:
    """An OBJ file of vertices (n, 3) m, faces (k, 3) and uv (n, 2), v upwards."""
    lines = ["v " + " ".join(map(_decimal, row)) for row in vertices]
    if uv is not None:
        lines += ["vt " + " ".join(map(_decimal, row)) for row in uv]
        lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in faces + 1]
    else:
        lines += ["f " + " ".join(map(str, face)) for face in faces + 1]
    return ("\n".join(lines) + "\n").encode()


def _decimal(value: Array) -> str:
    return np.format_float_positional(np.float32(value), trim="0")


def _write(path: Path, content: bytes | str) -> None:
    part = path.with_name(path.name + ".part")
    part.write_bytes(content.encode() if isinstance(content, str) else content)
    part.replace(path)

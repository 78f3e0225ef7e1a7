"""Panoramas against exact rays, and against panoramas that are rotated, repeated, from another process or without culling."""

import gc
import multiprocessing
import os
import subprocess
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim.rendering import draw_list, opengl_renderer
from sim.rendering.coverage import UnoccludedExtent
from sim.rendering.cubemap import CUBE, RenderedImage
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.rays import Agreement, bearings, cast, compare
from tests.sim.rendering.test_cubemap import FOLDED
from tests.sim.scenes import EYE, Scene, add_person, compiled, court
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from worlds import catalogue

pytestmark = pytest.mark.render
CAMERA = Panorama(1024, 512)
SMALL = Panorama(256, 128)
PEOPLE = [1, 2, 3, 4, 5]
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return court()


@pytest.fixture(scope="module")
def renderer(scene: Scene) -> Iterator[PanoramaRenderer]:
    with PanoramaRenderer(scene.model, CAMERA, scene.instances) as opened:
        yield opened


@pytest.fixture(scope="module")
def shots(scene: Scene, renderer: PanoramaRenderer) -> list[RenderedImage]:
    return renderer.render(scene.data, scene.poses)


@pytest.fixture(scope="module")
def unoccluded(scene: Scene, renderer: PanoramaRenderer) -> list[list[UnoccludedExtent]]:
    return renderer.unoccluded(scene.data, scene.poses, PEOPLE)


def digest(shot: RenderedImage) -> tuple[int, int, int]:
    return zlib.crc32(shot.colour.tobytes()), zlib.crc32(shot.instances.tobytes()), zlib.crc32(shot.range.tobytes())


def small_digests() -> list[tuple[int, int, int]]:
    scene = court()
    with PanoramaRenderer(scene.model, SMALL, scene.instances) as renderer:
        return [digest(shot) for shot in renderer.render(scene.data, scene.poses)]


@pytest.mark.parametrize("view", [0, 1])
def test_instances_and_range_are_those_of_exact_rays(scene: Scene, shots: list[RenderedImage], view: int) -> None:
    found = compare(shots[view], scene.instances, *cast(scene.model, scene.data, CAMERA, scene.poses[view]))
    assert found.everywhere > 0.995
    assert found.inside == 1
    assert found.share > 0.5
    assert found.median < 0.0001
    assert found.percentile < 0.01


def test_past_the_fold_of_a_lens_the_picture_is_black(scene: Scene) -> None:
    pose = Pose.planar(-6.0, -1.0, 0.3, 1.4)
    with PanoramaRenderer(scene.model, [SMALL, FOLDED], scene.instances, np.ones(scene.model.ngeom, np.uint8)) as renderer:
        # What is left in the buffer of another camera is not seen there.
        _, shot = renderer.render(scene.data, [pose] * 2, which=[0, 1])
        bodies = renderer.unoccluded(scene.data, [pose], PEOPLE, which=[1])[0]
    v, u = np.mgrid[:576, :720]
    blind = FOLDED.folded(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(576, 720)
    for black in (shot.colour, shot.instances, shot.classes):
        assert not black[blind].any()
    assert np.isinf(shot.range[blind]).all()
    geom, distance = cast(scene.model, scene.data, FOLDED, pose)
    found = compare(shot, scene.instances, np.where(blind, -1, geom).astype(np.int32), np.where(blind, np.inf, distance))
    assert found.everywhere > 0.99
    assert found.inside > 0.9999
    visible = np.bincount(shot.instances.ravel(), minlength=6)
    assert visible[1:].any()
    assert all(visible[k] <= body.pixels for k, body in zip(PEOPLE, bodies, strict=True))


def test_classes_are_those_of_the_geoms_and_0_is_the_sky(scene: Scene) -> None:
    classes = np.arange(scene.model.ngeom, dtype=np.uint8) % 7 + 1
    with PanoramaRenderer(scene.model, SMALL, scene.instances, classes) as renderer:
        (shot,) = renderer.render(scene.data, scene.poses[:1])
    assert ((shot.classes == 0) == np.isinf(shot.range)).all()
    people = shot.instances > 0
    geoms = np.unique(classes[scene.instances > 0])
    assert set(np.unique(shot.classes[people])) <= set(geoms.tolist())


def test_images_are_continuous_across_faces_and_the_seam(scene: Scene, renderer: PanoramaRenderer, shots: list[RenderedImage]) -> None:
    # Turned by an eighth, other pixels lie at the borders: there the two may differ no more than elsewhere.
    eighth = Pose.planar(0.0, 0.0, np.pi / 4)
    (turned,) = renderer.render(scene.data, [scene.poses[0] @ eighth])
    difference = np.abs(np.roll(turned.colour, -CAMERA.width // 8, axis=1).astype(float) - shots[0].colour).mean(axis=2)
    table = renderer._tables[0]
    face = np.searchsorted([one.row for one in table.faces], table.nearest // table.width, side="right")
    border = (face != np.roll(face, 1, axis=1)) | (face != np.roll(face, -1, axis=1)) | (face != np.roll(face, 1, axis=0))
    assert difference[border].mean() < 1.5 * difference[~border].mean() + 0.1
    steps = np.abs(np.diff(shots[0].colour.astype(float), axis=1)).mean(axis=(0, 2))
    seam = np.abs(shots[0].colour[:, 0].astype(float) - shots[0].colour[:, -1]).mean()
    assert seam < 2 * np.median(steps) + 0.5
    for row in (0, -1):
        assert np.ptp(shots[0].colour[row].astype(int), axis=0).max() < 40


def test_culling_changes_nothing(scene: Scene, renderer: PanoramaRenderer, shots: list[RenderedImage], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draw_list, "CULLING_MARGIN", 1e9)
    for all_drawn, shot in zip(renderer.render(scene.data, scene.poses), shots, strict=True):
        assert digest(all_drawn) == digest(shot)


def mujocos_faces(side: int) -> list[np.ndarray]:
    """The faces of a cube at the court's first pose, by MuJoCo's renderer.

    The process must have started after the choice of the GL backend, because `import mujoco` reads it.
    """
    scene, pictures = court(), []
    scene.model.vis.global_.offwidth = scene.model.vis.global_.offheight = side
    option = mujoco.MjvOption()
    option.geomgroup[:], option.sitegroup[:] = (1, 1, 1, 1, 0, 0), 0
    with mujoco.Renderer(scene.model, side, side) as theirs:
        for axes in CUBE:
            theirs.update_scene(scene.data, mujoco.MjvCamera(), option)
            for camera in theirs.scene.camera:
                camera.pos, camera.forward, camera.up = scene.poses[0].translation, axes[0], axes[2]
                camera.frustum_center, camera.frustum_width, camera.orthographic = 0, 0.02, 0
                camera.frustum_bottom, camera.frustum_top, camera.frustum_near, camera.frustum_far = -0.02, 0.02, 0.02, 500
            for light in theirs.scene.lights[: theirs.scene.nlight]:
                light.pos = scene.poses[0].translation if light.headlight else light.pos
            pictures.append(theirs.render())
    return pictures


@pytest.mark.command
def test_the_light_is_mujocos(shots: list[RenderedImage]) -> None:
    """They differ only at the edges of shapes and shadows."""
    side, components = 512, bearings(CAMERA)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        theirs = pool.apply(mujocos_faces, (side,))
    owner = np.argmax(components @ CUBE[:, 0].T, axis=1)
    for k, (axes, picture) in enumerate(zip(CUBE, theirs, strict=True)):
        mine = owner == k
        at = (components[mine] @ axes.T) / (components[mine] @ axes[:1].T)
        column = np.clip((at[:, 1] + 1) / 2 * side, 0, side - 1).astype(int)
        row = np.clip((1 - at[:, 2]) / 2 * side, 0, side - 1).astype(int)
        difference = np.abs(picture[row, column].astype(int) - shots[0].colour.reshape(-1, 3)[mine]).mean(axis=1)
        assert np.median(difference) < 5, k
        assert (difference > 40).mean() < 0.04, k


def test_visible_pixels_are_within_the_unoccluded_extent(shots: list[RenderedImage], unoccluded: list[list[UnoccludedExtent]]) -> None:
    for shot, bodies in zip(shots, unoccluded, strict=True):
        visible = np.bincount(shot.instances.ravel(), minlength=6)
        assert all(visible[k] <= body.pixels for k, body in zip(PEOPLE, bodies, strict=True))
    u0, _, u1, _ = unoccluded[0][3].box
    assert 0 < u0 < CAMERA.width < u1 < u0 + 200
    # Person 3 is hidden by the board from the first camera; 5 stands free.
    assert np.count_nonzero(shots[0].instances == 3) < 0.5 * unoccluded[0][2].pixels
    assert np.count_nonzero(shots[0].instances == 5) == unoccluded[0][4].pixels > 500


def test_renderers_at_once_and_one_after_the_other(scene: Scene) -> None:
    unoccluded = small_digests()
    with PanoramaRenderer(scene.model, SMALL, scene.instances) as a, PanoramaRenderer(scene.model, Panorama(128, 64), scene.instances) as b:
        first = [digest(shot) for shot in a.render(scene.data, scene.poses)]
        b.render(scene.data, scene.poses)
        assert [digest(shot) for shot in a.render(scene.data, scene.poses)] == first == unoccluded
    assert small_digests() == unoccluded


def test_closing(scene: Scene) -> None:
    renderer = PanoramaRenderer(scene.model, SMALL, scene.instances)
    renderer.close()
    renderer.close()
    with pytest.raises(ValueError, match="closed"):
        renderer.render(scene.data, scene.poses)
    forgotten = PanoramaRenderer(scene.model, SMALL, scene.instances)
    finalizer = forgotten._finalizer
    del forgotten
    gc.collect()
    assert not finalizer.alive


@pytest.mark.command
@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_each_backend_renders_and_exits_without_messages(backend: str) -> None:
    # Where a backend is not there mujoco cannot even be imported: we say so before it is.
    program = (
        "from sim.rendering.gl_context import open_context; open_context().free(); from tests.sim.rendering.test_panorama import *; scene = court();"
        "kept = PanoramaRenderer(scene.model, SMALL, scene.instances);"
        "shots = kept.render(scene.data, scene.poses); print(sorted(set(shots[0].instances.ravel().tolist())))"
    )
    kept = {key: value for key, value in os.environ.items() if key != "PYOPENGL_PLATFORM"}
    done = subprocess.run([sys.executable, "-c", program], env=kept | {"MUJOCO_GL": backend}, cwd=ROOT, capture_output=True, text=True, check=False)
    if "GLUnavailable" in done.stderr:
        pytest.skip(f"{backend} is not installed here: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().startswith("[0, 1, 2, ")
    assert not done.stderr


def test_the_model_is_not_changed(scene: Scene) -> None:
    quality, size = scene.model.vis.quality, scene.model.vis.global_
    before = quality.shadowsize, quality.offsamples, quality.numslices, size.offwidth, size.offheight
    PanoramaRenderer(scene.model, SMALL, scene.instances).close()
    assert before == (quality.shadowsize, quality.offsamples, quality.numslices, size.offwidth, size.offheight)


def test_what_does_not_fit_is_refused(scene: Scene, renderer: PanoramaRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    for which in ([0], [0, 1], [0, -1]):
        with pytest.raises(ValueError, match="needs 2 numbers of cameras, 0 to 0"):
            renderer.render(scene.data, scene.poses[:2], which=which)
    with pytest.raises(ValueError, match=r"int64 of shape .* needs uint16"):
        PanoramaRenderer(scene.model, SMALL, scene.instances.astype(np.int64))
    with pytest.raises(ValueError, match="needs uint16 of shape"):
        PanoramaRenderer(scene.model, SMALL, scene.instances[:-1])
    with pytest.raises(ValueError, match=r"class_of_geom is int64 .* needs uint8"):
        PanoramaRenderer(scene.model, SMALL, scene.instances, scene.instances.astype(np.int64))
    with pytest.raises(ValueError, match="there are 0 cameras"):
        PanoramaRenderer(scene.model, [], scene.instances)
    monkeypatch.setattr(opengl_renderer, "largest_buffer", lambda context: 16)
    with pytest.raises(ValueError, match=r"need a buffer of .* OpenGL's limit is 16 px"):
        PanoramaRenderer(scene.model, SMALL, scene.instances)
    with pytest.raises(ValueError, match="width = 2 height"):
        Panorama(256, 100)
    with pytest.raises(ValueError, match="width = 2 height"):
        Panorama(257, 128)


def test_instances_for_unoccluded_extents_are_checked(scene: Scene, renderer: PanoramaRenderer) -> None:
    (((nobody),),) = renderer.unoccluded(scene.data, scene.poses[:1], [99])
    assert nobody.pixels == 0
    assert np.isnan(nobody.box).all()
    for wrong in (0, -1, 1 << 16):
        with pytest.raises(ValueError, match=f"instance is {wrong}, needs 1 to 65535"):
            renderer.unoccluded(scene.data, scene.poses, [wrong])


def peopled(name: str, difficulty: float, seed: int) -> Scene:
    """A world with four people of capsules, and a camera pose."""
    rng = np.random.default_rng(seed)
    world = catalogue.build(name, rng, difficulty)
    spec = world.spec.copy()
    places = world.feet.sample(rng, 5, 0.3, 1.0)
    heights = world.terrain.height_at(places)
    for number, (place, height) in enumerate(zip(places[1:], heights[1:], strict=True), start=1):
        add_person(spec, number, float(place[0]), float(place[1]), rng)
        spec.body(f"person_{number}").pos = [*place, height]
    return compiled(spec, [Pose.planar(*places[0], float(rng.uniform(-3, 3)), float(heights[0]) + EYE)])


def check(found: Agreement) -> None:
    assert found.everywhere >= 0.995
    assert found.inside == 1
    assert found.median < 0.002
    assert found.percentile < 0.01


def compared(scene: Scene) -> Agreement:
    with PanoramaRenderer(scene.model, CAMERA, scene.instances) as renderer:
        (shot,) = renderer.render(scene.data, scene.poses)
    return compare(shot, scene.instances, *cast(scene.model, scene.data, CAMERA, scene.poses[0]))


@pytest.mark.parametrize(
    ("name", "difficulty"),
    [("pilsun", 0.5), ("forest", 0.5), *(pytest.param(name, 1.0, marks=pytest.mark.soak) for name in sorted(catalogue.WORLDS))],
)
def test_every_world_is_drawn_as_rays_see_it(name: str, difficulty: float) -> None:
    check(compared(peopled(name, difficulty, 1)))


def test_people_and_robots_are_drawn_as_rays_see_them_near_and_far() -> None:
    simulation = Simulation(Scenario(people=12, robots=3, seed=2))
    owners = (simulation.person_of_geom + 100 * simulation.robot_of_geom).astype(np.uint16)
    poses = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
    with PanoramaRenderer(simulation.model, CAMERA, owners) as renderer:
        for pose, shot in zip(poses, renderer.render(simulation.data, poses), strict=True):
            check(compare(shot, owners, *cast(simulation.model, simulation.data, CAMERA, pose)))

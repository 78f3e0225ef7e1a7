"""Camera models against exact rays, the stitched panorama against both lenses, and texts of cameras."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from scipy import ndimage

from sim.cameras import Rig, parse_camera
from sim.cameras.partial import PartialCamera
from sim.rendering.coverage import UnoccludedExtent
from sim.rendering.cubemap import RenderedImage
from sim.rendering.panorama import PanoramaRenderer
from tests.sim.rays import cast, silhouettes
from tests.sim.scenes import Scene, court
from tracker.geometry import Pose
from tracker.geometry.cameras import Camera, Fisheye

POSE = Pose.planar(-6.0, -1.0, 0.3, 1.4)
PEOPLE = range(1, 6)
MODELS = [
    "equirectangular",
    "fisheye:fov=200,k1=0.02,pitch=20",
    "pinhole:fov=80,k1=-0.1,k2=0.01,p1=0.001",
    "cylindrical:fov=70",
    "tum-vi:width=256",
    "euroc:width=376,yaw=10",
    "dual-fisheye:fov=200,baseline=0.1,distance=4",
    "dual-fisheye:focal_error=2",
]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return court()


@pytest.fixture(scope="module")
def shots(scene: Scene) -> Iterator[dict[str, list[tuple[Camera, Pose, RenderedImage, list[UnoccludedExtent]]]]]:
    """Model → every camera that is rendered for it, its pose, its image, and the extents of all five people without occlusion."""
    wanted: dict[str, list[tuple[Camera, Pose]]] = {}
    for text in MODELS:
        rig = Rig.of(text, 512)
        wanted[text] = [(lens.camera, POSE @ lens.T_rig_view) for lens in rig.lenses]
        if rig.stitching:
            wanted[text] += [(half, POSE @ T) for half, T in zip(rig.stitching.halves, rig.stitching.T_rig_lens, strict=True)]
    cameras = list(dict.fromkeys(camera for entries in wanted.values() for camera, _ in entries))
    with PanoramaRenderer(scene.model, cameras, scene.instances) as renderer:
        out = {}
        for text, entries in wanted.items():
            poses, which = [pose for _, pose in entries], [cameras.index(camera) for camera, _ in entries]
            images, extents = renderer.render(scene.data, poses, which), renderer.unoccluded(scene.data, poses, PEOPLE, which)
            out[text] = [(*entry, *seen) for entry, *seen in zip(entries, images, extents, strict=True)]
        yield out


@pytest.mark.render
@pytest.mark.parametrize("text", MODELS)
def test_instances_range_and_boxes_are_those_of_rays(scene: Scene, shots: dict, text: str) -> None:
    rng, boxes = np.random.default_rng(3), 0
    for camera, pose, shot, extents in shots[text]:
        geom, distance = cast(scene.model, scene.data, camera, pose)
        away = ~silhouettes(geom, distance)
        v, u = np.nonzero(away)
        pixels = np.stack([u, v], axis=1) + camera.pixel_centre
        seen = ~camera.blind(pixels)
        chosen = rng.choice(np.flatnonzero(seen), 1000, replace=False)
        u, v = u[chosen], v[chosen]
        truth = np.where(geom[v, u] < 0, 0, scene.instances[geom[v, u]])
        assert (shot.instances[v, u] == truth).mean() >= 0.999
        hit = np.isfinite(distance[v, u])
        error = np.abs(shot.range[v, u][hit] - distance[v, u][hit]) / distance[v, u][hit]
        assert np.median(error) < 0.0005
        assert np.percentile(error, 99) < 0.01
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        outside = camera.blind(np.stack([u.ravel(), v.ravel()], axis=1) + camera.pixel_centre).reshape(geom.shape)
        person_of_ray = np.where(outside | (geom < 0), 0, scene.instances[geom])
        pixels_of_rays = np.bincount(person_of_ray.ravel(), minlength=6)
        for person in PEOPLE:
            if pixels_of_rays[person] > 30:
                assert np.abs(_box(shot.instances == person) - _box(person_of_ray == person)).max() <= 1, person
                boxes += 1
        # The box of the whole body, against rays that pass through all that is not this body.
        person = int(np.argmax(pixels_of_rays[1:])) + 1
        if pixels_of_rays[person] > 30 and extents[person - 1].box[2] <= camera.width:
            with _alone(scene, person):
                geom, _ = cast(scene.model, scene.data, camera, pose)
            assert np.abs(extents[person - 1].box - _box((geom >= 0) & ~outside)).max() <= 1, person
    assert boxes
    assert any(shot.instances.any() for _, _, shot, _ in shots[text])


@contextmanager
def _alone(scene: Scene, person: int) -> Iterator[None]:
    """Rays hit this person alone: all other shapes are in a group that rays leave out."""
    groups = scene.model.geom_group.copy()
    scene.model.geom_group[scene.instances != person] = 5
    try:
        yield
    finally:
        scene.model.geom_group[:] = groups


def _box(mask: np.ndarray) -> np.ndarray:
    """Left, top, right and bottom px of the pixels of a mask."""
    v, u = np.nonzero(mask)
    return np.array([u.min(), v.min(), u.max() + 1, v.max() + 1])


@pytest.mark.render
def test_blind_pixels_of_a_round_image_show_nothing(shots: dict) -> None:
    camera, _, shot, _ = shots["dual-fisheye:fov=200,baseline=0.1,distance=4"][0]
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        assert not shot.colour[corner].any()
        assert np.isinf(shot.range[corner])
    assert shot.colour[camera.height // 2, camera.width // 2].any()


@pytest.mark.render
def test_instances_at_the_seam_are_those_of_the_pictures_of_both_lenses(scene: Scene) -> None:
    """A pixel beside the seam of the stitched truth, against the raw pictures: the lens that owns it shows the same person in the same direction."""
    rig = Rig.of("dual-fisheye:fov=200,baseline=0.1,distance=4,lens=512", 512)
    assert rig.stitching
    stitching, lens = rig.stitching, rig.stitching.lens
    cameras: list[Camera] = [*stitching.halves, lens]
    # The seam lies across a person, on the right and on the left.
    for pose in (Pose.planar(0.0, 0.0, 0.124, 1.4), Pose.planar(0.0, 0.0, -1.249, 1.4)):
        poses = [pose @ T for T in stitching.T_rig_lens]
        with PanoramaRenderer(scene.model, cameras, scene.instances) as renderer:
            halves, raw = renderer.render(scene.data, poses, [0, 1]), renderer.render(scene.data, poses, [2, 2])
        for k in (0, 1):
            u, v = np.meshgrid(np.r_[100:156, 356:412], np.arange(60, 200))
            pixels = np.stack([u.ravel() + 0.5, v.ravel() + 0.5], axis=1)
            pixels = pixels[~stitching.halves[k].blind(pixels)]
            bearings = stitching.lens_bearings(stitching.panorama.bearings_from_pixels(pixels), k)
            in_lens, seen = lens.pixels_from_bearings(bearings)
            assert seen.all()
            column, row = np.rint(in_lens).astype(int).T
            u, v = pixels.astype(int).T
            # Pixels at a silhouette may fall to either side.
            inside = ndimage.maximum_filter(raw[k].instances, 3) == ndimage.minimum_filter(raw[k].instances, 3)
            same = halves[k].instances[v, u] == raw[k].instances[row, column]
            assert same[inside[row, column]].mean() > 0.999
            assert len(np.unique(halves[k].instances[v, u])) > 1
            own, other = halves[k].range[v, u], raw[k].range[row, column]
            hit = np.isfinite(own) & np.isfinite(other)
            assert abs(np.median(own[hit] / other[hit]) - 1) < 1e-3


def test_both_lenses_agree_at_the_stitching_distance_and_weights_sum_to_one() -> None:
    rig = Rig.of("dual-fisheye:fov=200,baseline=0.1,distance=4,feather=6", 512)
    assert rig.stitching
    s = rig.stitching
    azimuth = np.radians(np.arange(-180, 180, 0.5))
    bearings = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    for k, T in enumerate(s.T_rig_lens):
        own = s.lens_bearings(bearings, k)
        points = T.apply(own * np.linalg.norm(T.inverse().apply(4 * bearings), axis=1)[:, None])
        np.testing.assert_allclose(points, 4 * bearings, atol=1e-12)
    weight = s.weights(bearings)
    np.testing.assert_allclose(weight + s.weights(-bearings), 1, atol=1e-12)
    blended = np.degrees(azimuth[(weight > 0) & (weight < 1)])
    assert np.abs(np.abs(blended) - 90).max() < 3.001
    assert s.weights(bearings)[len(azimuth) // 2] == 1


def test_a_flat_picture_stays_flat_when_it_is_stitched() -> None:
    rig = Rig.of("dual-fisheye", 256)
    assert rig.stitching
    flat = np.full((128, 128, 3), 77, np.uint8)
    assert (rig.stitching.stitched((flat, flat)) == 77).all()


@pytest.mark.parametrize("text", ["dual-fisheye:baseline=0.2,distance=2,fov=220", "dual-fisheye:focal_error=-3,fov=220"])
def test_directions_of_a_half_panorama_are_inverted(text: str) -> None:
    rig = Rig.of(text, 512)
    assert rig.stitching
    rng = np.random.default_rng(0)
    for half in rig.stitching.halves:
        pixels = rng.uniform([0, 60], [512, 200], (400, 2))
        pixels = pixels[~half.blind(pixels)]
        found, inside = half.pixels_from_bearings(half.bearings_from_pixels(pixels))
        assert inside.all()
        np.testing.assert_allclose(found, pixels, atol=1e-6)


def test_a_part_of_a_camera_has_its_pixels() -> None:
    camera = Fisheye(64, 64, 20.0, 20.0, 31.5, 31.5, field_of_view=np.radians(170))
    mask = np.zeros((64, 64), bool)
    mask[20:30, 5:60] = True
    part = PartialCamera.of(camera, mask)
    assert (part.width, part.height, part.left, part.top) == (55, 10, 5, 20)
    pixels = np.array([[0.0, 0.0], [30.0, 7.0]])
    np.testing.assert_array_equal(part.bearings_from_pixels(pixels), camera.bearings_from_pixels(pixels + np.array([5.0, 20.0])))
    whole = np.zeros((64, 64), int)
    part.paste(np.ones((10, 55), int), whole)
    assert (whole == mask).all()
    with pytest.raises(ValueError, match="needs a pixel"):
        PartialCamera.of(camera, np.zeros((64, 64), bool))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fishey", r"'fishey' \(fisheye\?\), needs one of"),
        ("fisheye:fow=3", r"'fow=3' \(fov\?\)"),
        ("dual-fisheye:fov=170", "for stitching"),
        ("dual-fisheye:baseline=1", r"needs a number in \[0, 0.3\] m"),
        ("dual-fisheye:fov=181", "too narrow for feather"),
        ("dual-fisheye:output=x", "needs one of both, stitched, raw"),
        ("euroc:fx=3", "published calibration"),
        ("pinhole:width=33", "even whole number"),
        ("pinhole:width=33.5", "even whole number"),
        ("pinhole:fov=90,fx=100", "needs either fov"),
        ("pinhole:fov=90,fov=80", "fov twice"),
        ("cylindrical:fov=nan", "needs a number in"),
        ("equirectangular:fov=3", "no options"),
    ],
)
def test_texts_that_are_no_camera(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        parse_camera(text)
    assert "\n" not in str(error.value)


def test_a_published_camera_is_that_of_its_source() -> None:
    (lens,) = Rig.of("euroc:width=752", 1024).lenses
    assert (lens.camera.width, lens.camera.height) == (752, 480)
    front = Rig.of("theta-sc", 1024).lenses[0].camera
    assert isinstance(front, Fisheye)
    # 4.7488 px a degree, as measured.
    assert front.fx * np.pi / 180 == pytest.approx(4.7488, abs=1e-4)
    assert Rig.of("theta-sc", 1024).stitching

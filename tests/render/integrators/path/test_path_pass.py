# SPDX-License-Identifier: Apache-2.0
"""The path pass: furnace tests, closed forms, MIS, sampling, textures, the lens and invalid input."""

import math

import numpy as np
import pytest

from dynamics.rotation import matrix_from_quaternion
from tests.render.bsdfs.test_bsdfs import MATERIALS
from tests.render.path_scenes import (
    BOX_CAMERA,
    CORNELL,
    WHITE,
    ball,
    box,
    described,
    device_scene,
    lit_box,
    matte,
    quad,
    render,
    towards,
)
from tests.render.tracing import compiled_kernels
from tiscene.errors import ArgumentError
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import (
    DistantLight,
    DomeLight,
    Material,
    Mesh,
    RectLight,
    SphereLight,
    Texture,
    TextureLookup,
)

SKY = DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0))
CLOSE = Camera.look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), vertical_fov=math.radians(26.0))
FLOOR = quad((-50, 0, 50), (50, 0, 50), (50, 0, -50), (-50, 0, -50))


def floor_radiance(light: object, material: Material | None = None, textures: tuple[Texture, ...] = ()) -> float:
    """Return the radiance of the floor at the origin by direct light of one light; default albedo 1."""
    scene = described([FLOOR], [material or matte("white", WHITE)], [light], textures)
    camera = Camera.look_at((3.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), vertical_fov=math.radians(0.1))
    return float(render(scene, camera, (8, 8), spp=64, max_depth=2).hdr[..., 1].mean())


@pytest.mark.parametrize("name", ["matte", "rough metal", "lacquer", "glass", "rough glass", "metallic glass"])
def test_white_furnace(name: str) -> None:
    """A white ball in a white environment is invisible: means are 1 within 1 %. All materials: test_bsdfs.py."""
    scene = described([ball((0.0, 0.0, 0.0), 0.8, subdivisions=5)], [MATERIALS[name]], [SKY])
    image = render(scene, CLOSE, (24, 24), spp=256, max_depth=64).hdr
    assert image.mean() == pytest.approx(1.0, abs=0.01)
    assert image[8:16, 8:16].mean() == pytest.approx(1.0, abs=0.01)


def test_closed_furnace_with_russian_roulette() -> None:
    """Inside a closed box of albedo a and emission e, radiance is e / (1 - a)."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    sides = [quad(*(tuple(corners[k]) for k in face)) for face in faces]
    scene = described(sides, [matte("wall", (0.6, 0.6, 0.6), emissive_color=(0.4, 0.4, 0.4))])
    camera = Camera.look_at((0.3, 0.2, 0.1), (1.0, 0.5, 0.0))
    assert render(scene, camera, spp=64, max_depth=60).hdr.mean() == pytest.approx(1.0, abs=0.01)
    assert render(scene, camera, spp=64, max_depth=3).hdr.mean() == pytest.approx(0.4 * (1 + 0.6 + 0.36), abs=0.002)
    assert render(scene, camera, spp=4, max_depth=1).hdr == pytest.approx(0.4, abs=1e-6)


def test_point_and_distant_lights_match_closed_form() -> None:
    point = SphereLight("l", "/l", towards((0.0, 2.0, 1.0), (0.0, -1.0, 0.0)), (0.0, 7.0, 0.0), 0.0)
    cosine = 2.0 / math.sqrt(5.0)
    assert floor_radiance(point) == pytest.approx(7.0 * cosine / 5.0 / math.pi, rel=1e-3)
    sun = DistantLight("l", "/l", towards((0.0, 0.0, 0.0), (0.0, -3.0, 4.0)), (0.0, 7.0, 0.0), 0.0)
    assert floor_radiance(sun) == pytest.approx(7.0 * 0.6 / math.pi, rel=1e-3)


@pytest.mark.parametrize("others", [0, 1])
def test_small_light_does_not_shadow_itself(others: int) -> None:
    """Shadow rays begin at an offset origin, not at the point for which the light was sampled."""
    matrix = np.eye(4)
    matrix[:3, 3] = 0.0, 0.0, 0.5
    lamp = SphereLight("lamp", "/lamp", matrix, (1000.0,) * 3, 0.01)
    far = np.eye(4)
    far[:3, 3] = 50.0
    dark = SphereLight("dark", "/dark", far, (0.0,) * 3, 0.01)
    floor = quad((-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0))
    camera = Camera.look_at((0.3, 0.0, 0.1), (0.3, 0.001, 0.0), vertical_fov=np.radians(1.0))
    described_floor = described([floor], [matte("floor", (0.5,) * 3)], [lamp, *[dark] * others])
    image = render(described_floor, camera, (8, 8), spp=16, max_depth=2)
    distance2 = 0.3**2 + 0.5**2
    expected = 0.5 * 1000.0 * 0.01**2 * 0.5 / distance2**1.5
    assert image.hdr.mean() == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("casts_shadows", [True, False])
def test_shadowless_light_is_not_occluded(casts_shadows: bool) -> None:
    black = matte("black", (0.0, 0.0, 0.0))
    shade = quad((-0.5, 1.0, 0.5), (0.5, 1.0, 0.5), (0.5, 1.0, -0.5), (-0.5, 1.0, -0.5), material=1)
    above = towards((0.0, 2.0, 0.0), (0.0, -1.0, 0.0))
    light = SphereLight("l", "/l", above, WHITE, 0.2, casts_shadows=casts_shadows)
    scene = described([FLOOR, shade], [matte("white", WHITE), black], [light])
    camera = Camera.look_at((3.0, 0.8, 0.0), (0.0, 0.0, 0.0), vertical_fov=0.01)
    expected = 0.0 if casts_shadows else 0.2**2 / 2.0**2
    assert render(scene, camera, (8, 8), spp=64, max_depth=3).hdr.mean() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("depth", [2, 4])
def test_multipliers_of_diffuse_and_specular_response_add_up(depth: int) -> None:
    glossy = Material("glossy", diffuse_color=(0.5, 0.5, 0.5), roughness=0.3)
    camera = Camera.look_at((1.5, 1.0, 0.0), (0.0, 0.0, 0.0), vertical_fov=0.2)
    above = towards((-1.5, 1.0, 0.0), (0.0, -1.0, 0.0))

    def lit(diffuse: float, specular: float) -> float:
        light = RectLight("l", "/l", above, WHITE, 1.0, 1.0, diffuse=diffuse, specular=specular)
        scene = described([FLOOR], [glossy], [light])
        return float(render(scene, camera, (16, 16), spp=256, max_depth=depth).hdr.mean())

    whole, diffuse, specular = lit(1.0, 1.0), lit(1.0, 0.0), lit(0.0, 1.0)
    assert diffuse + specular == pytest.approx(whole, rel=0.01)
    assert min(diffuse, specular) > 0.1 * whole
    assert lit(2.0, 0.5) == pytest.approx(2.0 * diffuse + 0.5 * specular, rel=0.01)


def test_textured_dome_light() -> None:
    """Radiance 2 in the upper hemisphere, 0 in the lower; +y is up."""
    pixels = np.zeros((64, 128, 4), np.float32)
    pixels[:32, :, :3] = 2.0
    sky = DomeLight("sky", "/sky", np.eye(4), WHITE, 0)
    assert floor_radiance(sky, textures=(Texture("sky", pixels, "raw"),)) == pytest.approx(2.0, rel=0.01)


def test_texture_appears_in_radiance_and_albedo() -> None:
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[0, 0], pixels[1, 1] = (255, 0, 0, 255), (0, 0, 255, 255)
    painted = matte("painted", TextureLookup(0))
    plate = quad((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0))
    texture = Texture("t", pixels, wrap_s="clamp", wrap_t="clamp")
    image = render(described([plate], [painted], [SKY], [texture]), CLOSE, (64, 64), spp=16, max_depth=2)
    corners = {(0, 0): (1.0, 0.0, 0.0), (1, 1): (0.0, 0.0, 1.0), (0, 1): (0.0, 0.0, 0.0)}  # v = 1 is up
    for (row, column), color in corners.items():
        part = slice(2 + 48 * row, 14 + 48 * row), slice(2 + 48 * column, 14 + 48 * column)
        assert image.hdr[part].mean(axis=(0, 1)) == pytest.approx(color, abs=0.01)
        assert image.albedo[part].mean(axis=(0, 1)) == pytest.approx(color, abs=1e-4)
    assert image.normal[32, 32] == pytest.approx([0.0, 0.0, 1.0], abs=1e-5)


def test_textures_are_filtered_by_ray_cone() -> None:
    """A distant checkerboard is gray at one sample per pixel."""
    pixels = np.zeros((512, 512, 4), np.uint8)
    pixels[np.indices((512, 512)).sum(axis=0) % 2 == 0] = 255
    plate = quad((-20.0, 0.0, 20.0), (20.0, 0.0, 20.0), (20.0, 0.0, -20.0), (-20.0, 0.0, -20.0))
    floor = matte("floor", TextureLookup(0, uv_transform=(8.0, 0.0, 0.0, 0.0, 8.0, 0.0)))
    camera = Camera.look_at((0.0, 6.0, 0.0), (0.0, 0.0, -9.0), vertical_fov=0.4)
    scene = described([plate], [floor], [SKY], [Texture("t", pixels, "raw")])
    albedo = render(scene, camera, (64, 48), spp=1, max_depth=2).albedo[..., 0]
    assert albedo.mean() == pytest.approx(0.5, abs=0.01)
    assert albedo.std() < 0.1  # 0.5 for single texels


@pytest.mark.parametrize(
    "opacity",
    [
        {"opacity": 0.25, "opacity_mode": "presence"},
        {"opacity": TextureLookup(0, "a")},
        {"opacity": 0.25, "opacity_threshold": 0.2},
        {"opacity": 0.25, "opacity_threshold": 0.3},
    ],
    ids=["presence", "painted", "above the threshold", "below the threshold"],
)
def test_partially_opaque_surface_transmits(opacity: dict[str, object]) -> None:
    """A screen of opacity c reduces light and visibility of what is behind it by 1 - c."""
    coverage = {0.2: 1.0, 0.3: 0.0}.get(opacity.get("opacity_threshold"), 0.25)
    screen = quad((-1, 1, 1), (1, 1, 1), (1, 1, -1), (-1, 1, -1), material=1)
    black = Material("screen", diffuse_color=(0.0, 0.0, 0.0), use_specular_workflow=True, **opacity)
    pixels = np.full((1, 1, 4), 64, np.uint8)
    lights = [SphereLight("l", "/l", towards((0.0, 2.0, 0.0), (0, -1, 0)), WHITE, radius) for radius in (0.0, 0.3)]
    camera = Camera.look_at((3.0, 0.5, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), vertical_fov=math.radians(0.5))
    up = Camera.look_at((0.0, 0.2, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 1.0), vertical_fov=math.radians(5.0))
    for light in lights:
        images = []
        for meshes in ([FLOOR], [FLOOR, screen]):
            scene = described(meshes, [matte("white", WHITE), black], [light], [Texture("t", pixels)])
            images.append(render(scene, camera, (8, 8), spp=64, max_depth=2).hdr.mean())
        assert images[1] / images[0] == pytest.approx(1.0 - coverage, abs=0.02)
    assert render(scene, up, (8, 8), spp=64, max_depth=2).hdr.mean() == pytest.approx(1.0 - coverage, abs=0.02)


def test_mis_does_not_change_mean() -> None:
    description = lit_box()
    scene = device_scene(description)
    with_mis, without = (render(scene, BOX_CAMERA, (24, 24), spp=256, mis=mis).hdr for mis in (True, False))
    # The visible light itself is the same in both.
    assert with_mis.mean() == pytest.approx(without.mean(), rel=5e-3)


def test_mis_is_unbiased_with_many_lights() -> None:
    """Lights are selected by the surface normal, which is unknown where a BSDF-sampled ray hits a light."""
    random = np.random.default_rng(4)
    lamps = []
    for number in range(40):
        matrix = np.eye(4)
        matrix[:3, 3] = random.uniform(-0.8, 0.8, 3)
        lamps.append(SphereLight(f"{number}", f"/{number}", matrix, (2.0,) * 3, 0.08))
    scene = described(*box(CORNELL), lamps)
    both, sampled = (render(scene, BOX_CAMERA, (16, 16), spp=256, max_depth=3, mis=mis).hdr for mis in (True, False))
    seen_from_camera = sampled.max(axis=2) > 1.9
    difference = (both - sampled)[~seen_from_camera].mean() / sampled[~seen_from_camera].mean()
    assert abs(difference) < 0.01


def test_lights_are_visible_and_occlude() -> None:
    lamp = RectLight("l", "/l", towards((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), (3.0, 4.0, 5.0), 10.0, 10.0)
    wall = quad((-9, -9, -1), (9, -9, -1), (9, 9, -1), (-9, 9, -1))
    image = render(described([wall], [matte("w", WHITE)], [lamp, SKY]), CLOSE, spp=4, max_depth=1)
    assert image.hdr == pytest.approx(np.broadcast_to([3.0, 4.0, 5.0], image.hdr.shape))
    assert image.albedo.max() <= 1.0


def test_denoiser_features_see_through_mirrors() -> None:
    mirror = Material("mirror", diffuse_color=WHITE, metallic=1.0, roughness=0.0)
    front = quad((-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0))
    back = quad((-50, -50, 9), (-50, 50, 9), (50, 50, 9), (50, -50, 9), material=1)
    image = render(described([front, back], [mirror, matte("m", (0.2, 0.5, 0.9))], [SKY]), CLOSE, spp=4)
    assert image.albedo.mean(axis=(0, 1)) == pytest.approx([0.2, 0.5, 0.9], abs=1e-3)
    assert image.normal.mean(axis=(0, 1)) == pytest.approx([0.0, 0.0, -1.0], abs=1e-3)


@pytest.mark.parametrize("max_depth", [1, 2, 3])
def test_images_do_not_depend_on_materials_of_objects_that_are_not_there(max_depth: int) -> None:
    """Objects that emit or have holes may appear in a later frame. A mirror shows a wall and the sky."""
    mirror = Material("mirror", diffuse_color=WHITE, metallic=1.0, roughness=0.0)
    front = quad((-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0))
    back = quad((-50, -50, 9), (-50, 50, 9), (0, 50, 9), (0, -50, 9), material=1)
    materials = [mirror, matte("m", (0.2, 0.5, 0.9))]
    absent = [], [Material("lamp", emissive_color=WHITE)], [Material("holes", opacity=0.5, opacity_mode="presence")]
    images = [
        render(described([front, back], [*materials, *others], [SKY]), CLOSE, spp=4, max_depth=max_depth)
        for others in absent
    ]
    for other in images[1:]:
        for name in ("hdr", "albedo", "normal"):
            np.testing.assert_array_equal(getattr(other, name), getattr(images[0], name), err_msg=name)
    assert np.isclose(images[0].albedo[..., 2], 0.9).any() == (max_depth > 2)


def test_normal_map_tilts_shading_normal() -> None:
    """A normal map tilted by 30 degrees toward +u, lit from +u, is as bright as a surface tilted so."""
    lean = math.radians(30.0)
    code = (np.array([math.sin(lean), 0.0, math.cos(lean), 1.0]) * 0.5 + 0.5).astype(np.float32)
    texture = Texture("n", np.tile(code, (2, 2, 1)).astype(np.float32), encoding="raw")
    lookup = TextureLookup(0, scale=(2.0, 2.0, 2.0, 1.0), bias=(-1.0, -1.0, -1.0, 0.0))
    sun = DistantLight("sun", "/sun", towards((0, 0, 0), (-1.0, -1.0, 0.0)), (0.0, 1.0, 0.0))
    floor = matte("bumpy", WHITE, normal=lookup)
    expected = math.cos(math.radians(45.0 - 30.0)) / math.pi
    assert floor_radiance(sun, floor, (texture,)) == pytest.approx(expected, rel=2e-3)


def test_sobol_has_less_error_than_independent_sampling() -> None:
    """Sixteen samples of one frame against sixteen independent frames of one sample."""
    scene = device_scene(lit_box())
    reference = render(scene, BOX_CAMERA, spp=1024, max_depth=4).hdr
    together = render(scene, BOX_CAMERA, spp=16, max_depth=4, seed=5).hdr
    apart = np.mean(
        [render(scene, BOX_CAMERA, spp=1, max_depth=4, seed=6, frame_index=k).hdr for k in range(16)], axis=0
    )

    def error(image: np.ndarray) -> float:
        return float(np.mean((image - reference) ** 2))

    assert error(together) < 0.7 * error(apart)


def test_new_scene_or_size_compiles_no_kernel() -> None:
    render(lit_box(), BOX_CAMERA, (8, 8), spp=2)
    before = compiled_kernels()
    pixels = np.full((4, 4, 4), 99, np.uint8)
    materials = [matte("t", TextureLookup(0)), MATERIALS["milk glass"], MATERIALS["lacquer"]]
    scene = described(
        [FLOOR, ball((0, 0, 0), 0.5, 1), ball((1, 1, 0), 0.5, 2)], materials, [SKY], [Texture("t", pixels)]
    )
    render(scene, CLOSE, (19, 11), spp=3)
    assert compiled_kernels() == before


def test_empty_scene_shows_environment() -> None:
    assert render(described([], []), CLOSE, spp=1).hdr.max() == 0.0
    assert render(described([], [], [SKY]), CLOSE, spp=1).hdr == pytest.approx(1.0)


def test_no_self_intersection_far_from_origin() -> None:
    """Ray offsets scale with rounding: the same ball, 3 km away."""
    images = []
    for shift in (0.0, 3000.0):
        scene = described([ball((shift, 0.0, 0.0), 1.0, subdivisions=5)], [matte("m", (0.5, 0.5, 0.5))], [SKY])
        camera = Camera.look_at((shift, 0.0, 4.0), (shift, 0.0, 0.0), vertical_fov=math.radians(20.0))
        images.append(render(scene, camera, (16, 16), spp=16, max_depth=8).hdr)
    for image in images:
        assert image.mean() == pytest.approx(0.5, rel=0.01)
        assert image == pytest.approx(0.5, rel=0.2)


@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("size", [20.0, 2000.0])
def test_floor_does_not_shadow_itself(size: float, tilted: bool) -> None:
    """A white floor below a white sky is white, at any size and with other triangles in its plane."""
    near, far = 0.05, 0.5 * size
    square = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], float)
    rotation = matrix_from_quaternion((0.9, 0.3, -0.2, math.sqrt(0.06))) if tilted else np.eye(3)
    corners = np.concatenate([near * square, far * square]) @ rotation.T + (0.3 * size, 0.0, 0.1 * size)
    around = [[k, 4 + k, 4 + (k + 1) % 4] for k in range(4)] + [[k, 4 + (k + 1) % 4, (k + 1) % 4] for k in range(4)]
    triangles = np.array([[0, 1, 2], [0, 2, 3], *around], np.int32)
    floor = Mesh("floor", corners.astype(np.float32), triangles, np.zeros(len(triangles), np.int32))
    center = corners[:4].mean(axis=0)
    camera = Camera.look_at(tuple(center + rotation @ (0.3, 0.2, 0.1)), tuple(center), vertical_fov=math.radians(30.0))
    seen = render(described([floor], [matte("white", WHITE)], [SKY]), camera, (8, 8), spp=64, max_depth=2).hdr
    assert seen.mean() == pytest.approx(1.0, abs=2e-3)


def test_lens_blurs_out_of_focus_edges() -> None:
    plate = quad((-1, -1, 0), (0, -1, 0), (0, 1, 0), (-1, 1, 0))
    scene = device_scene(described([plate], [matte("w", (0, 0, 0), emissive_color=WHITE)]))
    sharp = Camera.look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), lens_radius=0.2, focus_distance=4.0)
    blurred = Camera.look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), lens_radius=0.2, focus_distance=1.0)
    transition = []
    for camera in (sharp, blurred):
        row = render(scene, camera, (64, 64), spp=64, max_depth=1).hdr[32, :, 0]
        transition.append(np.count_nonzero((row[24:40] > 0.03) & (row[24:40] < 0.97)))
    assert transition[0] <= 1
    assert transition[1] >= 6


@pytest.mark.parametrize("wrong", [{"spp": 0}, {"max_depth": 0}])
def test_numbers_out_of_range_raise(wrong: dict[str, int]) -> None:
    with pytest.raises(ArgumentError, match="at least 1"):
        render(described([], []), CLOSE, **wrong)


def test_mismatched_or_empty_size_raises() -> None:
    paths = PathPass(device_scene(described([], [])), 8, 8)
    with pytest.raises(ArgumentError, match="8x8"):
        paths.render(View(CLOSE, CLOSE, CLOSE, 8, 9), frame_index=0, seed=0, spp=1, max_depth=1)
    with pytest.raises(ArgumentError, match="0x8"):
        PathPass(device_scene(described([], [])), 0, 8)


def test_nonfinite_samples_are_counted_and_skipped() -> None:
    emissive = matte("emissive", (0.5, 0.5, 0.5), emissive_color=(float("inf"), 0.0, 0.0))
    plate = quad((-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0))
    paths = PathPass(device_scene(described([plate], [emissive], [SKY])), 8, 8)
    image = paths.render(View(CLOSE, CLOSE, CLOSE, 8, 8), frame_index=0, seed=0, spp=3, max_depth=3)
    assert paths.nonfinite == 8 * 8 * 3
    assert np.isfinite(image.hdr).all()

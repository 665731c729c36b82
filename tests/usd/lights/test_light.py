# SPDX-License-Identifier: Apache-2.0
"""UsdLux lights: units, sizes, poses and controls, after LightAPI's documentation."""

from __future__ import annotations

import math

import numpy as np
import OpenEXR
import pytest

from tests.usd.helpers import problems_of, read, read_with_warning
from tests.usd.lights.test_ies import ies
from tiscene.scene.description import CylinderLight, DiskLight, DistantLight, DomeLight, RectLight, SphereLight
from tiscene.usd.lights.light import color_of_temperature

SCALE = 'float3 xformOp:scale = %s\nuniform token[] xformOpOrder = ["xformOp:scale"]\n'


def light(kind: str, lines: str = "", apis: str = "") -> str:
    metadata = f"(prepend apiSchemas = [{apis}])" if apis else ""
    return f'def {kind} "L" {metadata}\n{{\n{lines}\n}}\n'


def only_light(description):
    (result,) = description.lights
    return result


def test_rect_light_defaults(tmp_path):
    rect = only_light(read(tmp_path, light("RectLight")))
    assert isinstance(rect, RectLight)
    assert (rect.radiance, rect.width, rect.height, rect.texture) == ((1.0, 1.0, 1.0), 1.0, 1.0, None)
    assert (rect.name, rect.prim_path) == ("L", "/L")
    np.testing.assert_array_equal(rect.world_from_light, np.eye(4))
    assert all(type(number) is float for number in (*rect.radiance, rect.width, rect.height))


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight", "SphereLight", "DomeLight"])
def test_radiance_is_intensity_times_exposure_times_color(tmp_path, kind):
    lines = "float inputs:intensity = 3\nfloat inputs:exposure = 2\ncolor3f inputs:color = (1, 0.5, 0.25)"
    assert only_light(read(tmp_path, light(kind, lines))).radiance == (12.0, 6.0, 3.0)


def test_color_temperature_multiplies_color_when_enabled(tmp_path):
    lines = "float inputs:colorTemperature = 3000\nfloat inputs:intensity = 2\n"
    assert only_light(read(tmp_path, light("RectLight", lines))).radiance == (2.0, 2.0, 2.0)  # not enabled
    warm = np.array(
        only_light(read(tmp_path, light("RectLight", lines + "bool inputs:enableColorTemperature = 1"))).radiance
    )
    assert warm @ (0.2126, 0.7152, 0.0722) == pytest.approx(2.0)
    assert warm[0] > 1.5 * warm[1] > 1.5 * warm[2]
    np.testing.assert_allclose(color_of_temperature(6500.0), 1.0)
    assert color_of_temperature(9000.0)[2] > 1.0 > color_of_temperature(9000.0)[0]
    np.testing.assert_array_equal(color_of_temperature(20000.0), color_of_temperature(10000.0))


def test_sizes_are_scaled_by_transform_and_unit(tmp_path):
    lines = SCALE % "(2, 3, 5)" + "float inputs:width = 4\nfloat inputs:height = 6\n"
    rect = only_light(read(tmp_path, light("RectLight", lines), meters=0.01))
    assert (rect.width, rect.height) == pytest.approx((0.08, 0.18))
    np.testing.assert_allclose(rect.world_from_light, np.eye(4))


@pytest.mark.parametrize("meters", [1.0, 0.01])
def test_normalize_divides_by_area_in_stage_units(tmp_path, meters):
    normalize = "bool inputs:normalize = 1\nfloat inputs:intensity = 12\n"
    rect = normalize + SCALE % "(2, 3, 1)" + "float inputs:width = 1\nfloat inputs:height = 2"
    assert only_light(read(tmp_path, light("RectLight", rect), meters=meters)).radiance[0] == pytest.approx(1.0)
    disk = normalize + "float inputs:radius = 2"
    assert only_light(read(tmp_path, light("DiskLight", disk), meters=meters)).radiance[0] == pytest.approx(
        3.0 / math.pi
    )
    sphere = normalize + SCALE % "(2, 2, 2)" + "float inputs:radius = 0.5"
    assert only_light(read(tmp_path, light("SphereLight", sphere), meters=meters)).radiance[0] == pytest.approx(
        3.0 / math.pi
    )
    dome = only_light(read(tmp_path, light("DomeLight", normalize), meters=meters))
    assert dome.radiance[0] == 12.0  # ignored


def test_cylinder_sizes_and_normalization(tmp_path):
    lines = SCALE % "(2, 3, 3)" + "float inputs:radius = 0.1\nfloat inputs:length = 4\nfloat inputs:intensity = 5\n"
    tube = only_light(read(tmp_path, light("CylinderLight", lines), meters=0.5))
    assert isinstance(tube, CylinderLight)
    assert (tube.radius, tube.length, tube.radiance[0]) == pytest.approx((0.15, 4.0, 5.0))
    normalized = only_light(read(tmp_path, light("CylinderLight", lines + "bool inputs:normalize = 1"), meters=0.5))
    assert normalized.radiance[0] == pytest.approx(5.0 / (2.0 * math.pi * 0.3 * 8.0))
    line = only_light(read(tmp_path, light("CylinderLight", "float inputs:radius = 0.1\nbool treatAsLine = 1")))
    assert line.radius * line.radiance[0] == pytest.approx(0.1)
    assert line.radius < 0.01


def test_uneven_scale_of_round_light_is_averaged(tmp_path):
    disk = only_light(read(tmp_path, light("DiskLight", SCALE % "(3, 3, 9)"), meters=0.1))
    assert isinstance(disk, DiskLight)
    assert disk.radius == pytest.approx(0.15)
    sphere = only_light(read(tmp_path, light("SphereLight", "float inputs:radius = 2")))
    assert isinstance(sphere, SphereLight)
    assert sphere.radius == 2.0
    uneven = only_light(read_with_warning(tmp_path, light("SphereLight", SCALE % "(1, 2, 3)"), "uneven scale.*</L>"))
    assert uneven.radius == pytest.approx(1.0)


def sheared(prim: str, shear: float) -> str:
    """Return a light whose transform adds `shear` times y to x."""
    rows = f"( (1, 0, 0, 0), ({shear}, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"
    lines = f'matrix4d xformOp:transform = {rows}\nuniform token[] xformOpOrder = ["xformOp:transform"]\n'
    return prim.replace("{\n", "{\n" + lines, 1)


@pytest.mark.parametrize(("kind", "sizes"), [("RectLight", ["width", "height"]), ("DiskLight", ["radius"])])
def test_sheared_light_keeps_its_area_and_is_reported(tmp_path, kind, sizes):
    lines = "bool inputs:normalize = 1\nfloat inputs:intensity = 12\nfloat inputs:width = 3\nfloat inputs:height = 2"
    upright = only_light(read(tmp_path, light(kind, lines)))
    leaning = only_light(read_with_warning(tmp_path, sheared(light(kind, lines), 1.0), "a light's shear .*: </L>"))
    for name in ("radiance", *sizes):
        assert getattr(leaning, name) == pytest.approx(getattr(upright, name), rel=1e-6)
    np.testing.assert_allclose(leaning.world_from_light, upright.world_from_light, atol=1e-12)
    assert only_light(read(tmp_path, sheared(light(kind, lines), 1e-4))).radiance == pytest.approx(upright.radiance)


def test_sphere_treated_as_point_keeps_its_power(tmp_path):
    lines = "float inputs:radius = 0.1\nbool treatAsPoint = 1\nfloat inputs:intensity = 5"
    point = only_light(read(tmp_path, light("SphereLight", lines)))
    assert point.radius == pytest.approx(0.001)
    assert point.radiance[0] * point.radius**2 == pytest.approx(5.0 * 0.1**2)


def test_normalized_sphere_of_zero_radius_keeps_its_power(tmp_path):
    lines = "float inputs:radius = 0\nbool inputs:normalize = 1\nfloat inputs:intensity = 5"
    point = only_light(read(tmp_path, light("SphereLight", lines)))
    assert point.radiance[0] * 4.0 * math.pi * point.radius**2 == pytest.approx(5.0)


DISTANT = [
    (0.0, False, 10.0),  # parallel light: the emission is the irradiance
    (0.0, True, 10.0),
    (60.0, False, 10.0 * math.pi * 0.25),  # L pi sin² 30°
    (60.0, True, 10.0),
    (0.53, True, 10.0),
    (180.0, False, 10.0 * math.pi),
]


@pytest.mark.parametrize(("angle", "normalize", "irradiance"), DISTANT)
def test_distant_light_irradiance(tmp_path, angle, normalize, irradiance):
    lines = f"float inputs:angle = {angle}\nbool inputs:normalize = {int(normalize)}\nfloat inputs:intensity = 10"
    sun = only_light(read(tmp_path, light("DistantLight", lines)))
    assert isinstance(sun, DistantLight)
    assert sun.irradiance[0] == pytest.approx(irradiance)
    assert sun.angle == pytest.approx(math.radians(angle), rel=1e-6)


@pytest.mark.parametrize(("normalize", "irradiance"), [(False, 10.0 * math.pi), (True, 10.0 / 1.5)])
def test_distant_light_wider_than_a_hemisphere_is_a_hemisphere(tmp_path, normalize, irradiance):
    """`normalize` divides by pi (2 - sin² 135°), as for the whole cone."""
    lines = f"float inputs:angle = 270\nbool inputs:normalize = {int(normalize)}\nfloat inputs:intensity = 10"
    sun = only_light(read_with_warning(tmp_path, light("DistantLight", lines), "wider than a hemisphere"))
    assert sun.irradiance[0] == pytest.approx(irradiance)
    assert sun.angle == pytest.approx(math.pi)


def test_distant_light_defaults(tmp_path):
    sun = only_light(read(tmp_path, light("DistantLight")))
    assert sun.irradiance[0] == pytest.approx(50000.0 * math.pi * math.sin(math.radians(0.265)) ** 2, rel=1e-5)


def test_light_pose_has_no_scale(tmp_path):
    lines = """
    double3 xformOp:translate = (1, 2, 3)
    float xformOp:rotateX = -90
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]
    """
    pose = only_light(read(tmp_path, light("RectLight", lines), meters=10.0)).world_from_light
    np.testing.assert_allclose(pose[:3, 3], (10, 20, 30))
    np.testing.assert_allclose(pose @ (0, 0, -1, 0), (0, -1, 0, 0), atol=1e-9)  # it points down
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)


def test_mirrored_light_points_along_its_minus_z(tmp_path):
    pose = only_light(read(tmp_path, light("RectLight", SCALE % "(1, 1, -1)"))).world_from_light
    np.testing.assert_allclose(pose @ (0, 0, -1, 0), (0, 0, 1, 0), atol=1e-9)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_dome_light_orientation(tmp_path):
    lines = """
    double3 xformOp:translate = (1, 2, 3)
    float xformOp:rotateY = 90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    """
    dome = only_light(read(tmp_path, light("DomeLight", lines)))
    assert isinstance(dome, DomeLight)
    np.testing.assert_allclose(dome.world_from_light @ (0, 0, 1, 0), (1, 0, 0, 0), atol=1e-9)
    np.testing.assert_array_equal(dome.world_from_light[:, 3], (0, 0, 0, 1))  # it is infinitely far away
    upright = only_light(read(tmp_path, light("DomeLight"), up="Z")).world_from_light
    np.testing.assert_array_equal(upright, np.eye(4))  # DomeLight's pole is +Y for every upAxis


@pytest.mark.parametrize(
    ("pole", "up", "tilted"),
    [("scene", "Y", False), ("scene", "Z", True), ("Y", "Z", False), ("Z", "Y", True)],
)
def test_dome_light_1_pole_axis(tmp_path, pole, up, tilted):
    matrix = only_light(read(tmp_path, light("DomeLight_1", f'token poleAxis = "{pole}"'), up=up)).world_from_light
    top, center = ((0, 0, 1), (0, -1, 0)) if tilted else ((0, 1, 0), (0, 0, 1))
    np.testing.assert_allclose(matrix[:3, :3] @ (0, 1, 0), top)
    np.testing.assert_allclose(matrix[:3, :3] @ (0, 0, 1), center)


def test_light_textures_are_read(tmp_path):
    pixels = np.arange(2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3)
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": pixels}) as file:
        file.write(str(tmp_path / "sky.exr"))
    description = read(
        tmp_path,
        light("DomeLight", "asset inputs:texture:file = @./sky.exr@") + light("RectLight").replace('"L"', '"R"'),
    )
    dome, rect = description.lights
    assert (dome.texture, rect.texture) == (0, None)
    np.testing.assert_array_equal(description.textures[0].pixels[..., :3], pixels)
    assert (description.textures[0].wrap_s, description.textures[0].wrap_t) == ("repeat", "clamp")
    body = light("RectLight", "asset inputs:texture:file = @./gone.exr@")
    expected = "there is no texture @./gone.exr@ .*the light is rendered without it: </L>"
    assert only_light(read_with_warning(tmp_path, body, expected)).texture is None


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -1, 1), (1, 1, -1), (-2, -1, -1), (-1, -1, 1), (1, 2, 3)])
@pytest.mark.parametrize("kind", ["RectLight", "DomeLight", "DomeLight_1"])
def test_scales_that_mirror_a_light_mirror_its_texture(tmp_path, kind, scale):
    """The image's columns run along the light's x axis, or against it where mirrored; its rows along y."""
    pixels = np.random.default_rng(0).random((2, 4, 3)).astype(np.float32)
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": pixels}) as file:
        file.write(str(tmp_path / "sky.exr"))
    description = read(tmp_path, light(kind, SCALE % (scale,) + "asset inputs:texture:file = @sky.exr@"))
    lamp, mirrored = only_light(description), np.prod(scale) < 0
    shown = description.textures[lamp.texture].pixels[..., :3]
    np.testing.assert_array_equal(shown, pixels[:, ::-1] if mirrored else pixels)
    flipped = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
    np.testing.assert_allclose(lamp.world_from_light[:3, :3] @ flipped, np.diag(np.sign(scale)), atol=1e-12)


def test_mirrored_light_without_an_image_keeps_its_pose(tmp_path):
    lamp = only_light(read(tmp_path, light("RectLight", SCALE % "(-1, 1, 1)")))
    np.testing.assert_allclose(lamp.world_from_light, np.diag([-1.0, -1.0, 1.0, 1.0]), atol=1e-12)


def test_mirrored_light_mirrors_its_profile(tmp_path):
    (tmp_path / "lamp.ies").write_bytes(ies([0, 180], [0, 90, 180, 270, 360], [[each] * 2 for each in (1, 5, 3, 2, 1)]))
    lines = "asset inputs:shaping:ies:file = @lamp.ies@"
    body = light("SphereLight", lines, '"ShapingAPI"').replace('"L"', '"Plain"')
    description = read(tmp_path, body + light("SphereLight", SCALE % "(1, -1, 1)" + lines, '"ShapingAPI"'))
    plain, mirrored = (description.textures[each.shaping.profile].pixels for each in description.lights)
    np.testing.assert_allclose(mirrored, np.roll(plain[:, ::-1], 180, axis=1), rtol=1e-6)
    np.testing.assert_allclose(description.lights[1].world_from_light, np.diag([-1.0, -1.0, 1.0, 1.0]), atol=1e-12)


def test_infinite_pixels_of_dome_texture_are_clamped(tmp_path):
    """An infinite pixel would take all light samples."""
    pixels = np.ones((2, 4, 3), np.float16)
    pixels[0, 1], pixels[1, 2, 0] = np.inf, np.nan
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": pixels}) as file:
        file.write(str(tmp_path / "sky.exr"))
    body = light("DomeLight", "asset inputs:texture:file = @./sky.exr@")
    expected = "2 pixels of texture @.*sky.exr@ not finite: inf becomes 65504, others 0: </L>"
    (texture,) = read_with_warning(tmp_path, body, expected).textures
    finite = np.ones((2, 4, 3))
    finite[0, 1], finite[1, 2, 0] = 65504.0, 0.0
    np.testing.assert_array_equal(texture.pixels[..., :3], finite)


def test_input_names_before_usd_21_02_are_read(tmp_path):
    lines = "float intensity = 7\nfloat width = 3\nbool normalize = 1\ncolor3f color = (1, 0, 0)"
    rect = only_light(read(tmp_path, light("RectLight", lines)))
    assert (rect.width, rect.radiance) == (3.0, (7.0 / 3.0, 0.0, 0.0))


def test_lights_without_emission_are_dropped(tmp_path):
    assert not read(tmp_path, light("RectLight", "float inputs:intensity = 0")).lights
    assert not read_with_warning(tmp_path, light("RectLight", "float inputs:width = 0"), "zero area").lights
    assert not read_with_warning(tmp_path, light("SphereLight", "float inputs:radius = 0"), "zero area").lights
    assert not read_with_warning(
        tmp_path, light("RectLight", "float inputs:intensity = -1"), "negative emission"
    ).lights


UNSUPPORTED = [
    ("RectLight", "rel light:filters = </F>", "", "light filters are not applied"),
    ("DomeLight", 'token inputs:texture:format = "angular"', "", "a dome texture of format 'angular'"),
    ("PluginLight", "", "", "lights of type PluginLight are not supported"),
    ("DistantLight", "float inputs:angle = 270", "", "wider than a hemisphere"),
]


@pytest.mark.parametrize(("kind", "lines", "apis", "expected"), UNSUPPORTED)
def test_unsupported_controls_are_reported(tmp_path, kind, lines, apis, expected):
    read_with_warning(tmp_path, light(kind, lines, apis), f"{expected}.*</L>")


def test_shaping_without_effect_is_not_reported(tmp_path):
    assert len(read(tmp_path, light("RectLight", apis='"ShapingAPI"')).lights) == 1


PROBLEMS = [
    ("float inputs:intensity = nan", "light: intensity nan"),
    ("float inputs:exposure = 5000", "light: intensity 1.0, exposure 5000.0"),
    ("color3f inputs:color = (inf, 0, 0)", "light: intensity 1.0"),
    (SCALE % "(0, 1, 1)", "light: its transform is singular or not finite"),
    ("float inputs:width = nan", "light: its area is nan"),
    ("float inputs:width = 0\nbool inputs:normalize = 1", "light: its area is 0.0"),
]


@pytest.mark.parametrize(("lines", "expected"), PROBLEMS)
def test_invalid_lights_are_problems(tmp_path, lines, expected):
    (problem,) = problems_of(tmp_path, light("RectLight", lines))
    assert problem.startswith(f"</L> {expected}")


PORTAL = """
def Xform "Wall" {
    double3 xformOp:translate = (0, 1, 0)
    float3 xformOp:scale = (2, 3, 1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    def PortalLight "Window" {
        float inputs:width = 0.5
    }
    def Sphere "Ball" {}
}
"""


@pytest.mark.parametrize("kind", ["DomeLight", "DomeLight_1"])
def test_dome_has_its_portals(tmp_path, kind):
    dome = only_light(read(tmp_path, light(kind, "rel portals = </Wall/Window>") + PORTAL, meters=0.01))
    (portal,) = dome.portals
    assert (portal.width, portal.height) == pytest.approx((0.01, 0.03))
    expected = np.eye(4)
    expected[1, 3] = 0.01
    np.testing.assert_allclose(portal.world_from_portal, expected)


def test_sheared_portal_keeps_its_area_and_is_reported(tmp_path):
    body = light("DomeLight", "rel portals = </P>") + sheared('def PortalLight "P"\n{\n}', 2.0)
    (portal,) = only_light(read_with_warning(tmp_path, body, "a portal's shear is not applied: </P>")).portals
    assert (portal.width, portal.height) == pytest.approx((1.0, 1.0))


def test_invalid_portal_targets_are_reported(tmp_path):
    body = light("DomeLight", "rel portals = </Wall/Ball>") + PORTAL
    dome = only_light(read_with_warning(tmp_path, body, "its portal </Wall/Ball> is not a PortalLight"))
    assert dome.portals == ()
    body = light("DomeLight", "rel portals = </P>") + 'def PortalLight "P"\n{\nfloat inputs:width = 0\n}'
    assert problems_of(tmp_path, body) == ("</P> portal: its size is 0.0 x 1.0 m",)


LAMP = 'def SphereLight "Lamp"\n{\n    %s\n}'
HIDES = 'token visibility.timeSamples = { 0: "inherited", 9: "invisible" }'


@pytest.mark.parametrize(
    ("body", "inputs", "present"),
    [
        (LAMP % "float inputs:radius.timeSamples = { 0: 1, 9: 2 }", ["radius"], ()),
        (LAMP % HIDES, [], (True, False)),
        (LAMP % HIDES.replace("9:", "-1:"), [], (False, True)),
        (f'def Xform "G"\n{{\n{HIDES}\n{LAMP % ""}\n}}', [], (True, False)),
    ],
)
def test_animated_inputs_and_visibility_become_a_track(tmp_path, body, inputs, present):
    description = read(tmp_path, body)
    (track,) = description.light_tracks
    assert len(description.lights) == 1
    assert [name for name, _ in track.inputs] == inputs
    assert track.present == present


def test_light_with_constant_time_samples_is_static(tmp_path):
    assert len(read(tmp_path, LAMP % "float inputs:radius.timeSamples = { 0: 1, 9: 1 }").lights) == 1

# SPDX-License-Identifier: Apache-2.0
"""UsdGeomBasisCurves as tubes and ribbons, UsdGeomPoints as spheres."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.usd.animated_stages import RANGE
from tests.usd.helpers import area, facing, problems_of, read, read_with_warning, volume

STRAIGHT = """
def BasisCurves "C"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [2, 3]
    point3f[] points = [(0, 0, 0), (0, 0, 4), (5, 0, 0), (6, 0, 0), (7, 0, 0)]
    float[] widths = %s
    %s
}
"""
COLORS = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (interpolation = "uniform")'
OCTAGON_AREA = 2.0 * math.sqrt(2.0)  # of a circumradius of 1


def test_linear_curves_are_closed_octagonal_prisms(tmp_path):
    (mesh,) = read(tmp_path, STRAIGHT % ('[2, 1] (interpolation = "uniform")', ""), meters=0.5).meshes
    assert volume(mesh.positions, mesh.triangles) == pytest.approx(OCTAGON_AREA * (4.0 + 0.25 * 2.0) / 8.0, rel=1e-5)
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    assert low[2] == pytest.approx(-0.25, abs=0.02)
    assert high == pytest.approx((3.5, 0.5, 2.0), abs=0.04)
    outward = np.einsum("ij,ij->i", facing(mesh.positions, mesh.triangles), mesh.normals[mesh.triangles].mean(axis=1))
    assert (outward > 0.8).all()


def test_uniform_colors_of_curves_become_materials(tmp_path):
    description = read(tmp_path, STRAIGHT % ("[1]", COLORS))
    (mesh,) = description.meshes
    colors = np.array([description.materials[row].diffuse_color for row in mesh.materials])
    upward = mesh.positions[mesh.triangles].mean(axis=1)[:, 0] < 2.0
    np.testing.assert_array_equal(colors, np.where(upward[:, None], (1, 0, 0), (0, 0, 1)))


@pytest.mark.parametrize(
    "widths", ["[2, 2, 1, 1, 1]", '[2, 2, 1, 1, 1] (interpolation = "varying")', '[2, 1] (interpolation = "uniform")']
)
def test_widths_of_each_interpolation_give_same_volume(tmp_path, widths):
    (mesh,) = read(tmp_path, STRAIGHT % (widths, "")).meshes
    assert volume(mesh.positions, mesh.triangles) == pytest.approx(OCTAGON_AREA * (4.0 + 0.25 * 2.0), rel=1e-5)


def test_ribbons_face_their_normals(tmp_path):
    normals = "normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1)]"
    (mesh,) = read(tmp_path, STRAIGHT % ("[0.5]", normals)).meshes
    assert area(mesh.positions, mesh.triangles) == pytest.approx(0.5 * (4.0 + 2.0))
    normal = facing(mesh.positions, mesh.triangles)
    np.testing.assert_allclose(normal[:2], [(0, 1, 0)] * 2, atol=1e-6)
    np.testing.assert_allclose(normal[2:], [(0, 0, 1)] * 4, atol=1e-6)


@pytest.mark.parametrize(
    ("normals", "interpolation"),
    [
        ("[(0, 1, 0)]", "constant"),
        ("[(0, 1, 0), (0, 0, 1)]", "uniform"),
        ("[(0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1)]", "varying"),
    ],
)
def test_normals_of_each_interpolation_make_ribbons(tmp_path, normals, interpolation):
    line = f'normal3f[] normals = {normals} (interpolation = "{interpolation}")'
    (mesh,) = read(tmp_path, STRAIGHT % ("[0.5]", line)).meshes
    assert area(mesh.positions, mesh.triangles) == pytest.approx(0.5 * (4.0 + 2.0))
    last = (0, 1, 0) if interpolation == "constant" else (0, 0, 1)
    normal = facing(mesh.positions, mesh.triangles)
    np.testing.assert_allclose(normal[[0, -1]], [(0, 1, 0), last], atol=1e-6)


def test_cubic_curves_with_normals_at_their_segment_ends_are_ribbons(tmp_path):
    points = [(0, 0, z) for z in range(7)]
    body = CUBIC % ("bezier", "nonperiodic", 7, points)
    normals = 'normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0)] (interpolation = "varying")'
    (mesh,) = read(tmp_path, body.replace("float[] widths", f"{normals}\n    float[] widths")).meshes
    np.testing.assert_allclose(mesh.positions[:, 1], 0.0, atol=1e-6)


def test_normals_that_do_not_fit_curves_are_named(tmp_path):
    line = "normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0)]"
    description = read_with_warning(tmp_path, STRAIGHT % ("[0.5]", line), "3 normals fit neither 2 curves.*</C>")
    assert volume(description.meshes[0].positions, description.meshes[0].triangles) > 0.1


def test_primvars_named_widths_and_normals_take_precedence_on_curves(tmp_path):
    lines = """normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")
    normal3f[] primvars:normals = [(0, 1, 0)] (interpolation = "constant")
    float[] primvars:widths = [9, 0.5] (interpolation = "uniform")
    int[] primvars:widths:indices = [1, 1]"""
    (mesh,) = read(tmp_path, STRAIGHT % ("[3]", lines)).meshes
    assert area(mesh.positions, mesh.triangles) == pytest.approx(0.5 * (4.0 + 2.0))
    np.testing.assert_allclose(facing(mesh.positions, mesh.triangles)[:2], [(0, 1, 0)] * 2, atol=1e-6)


def test_curves_whose_normals_are_zero_are_tubes(tmp_path):
    normals = f"normal3f[] normals = {[(0, 0, 0)] * 5}"
    tube, plain = (read(tmp_path, STRAIGHT % ("[0.5]", text)).meshes[0] for text in (normals, ""))
    np.testing.assert_array_equal(tube.positions, plain.positions)


CUBIC = """
def BasisCurves "C"
{
    uniform token type = "cubic"
    uniform token basis = "%s"
    uniform token wrap = "%s"
    int[] curveVertexCounts = [%d]
    point3f[] points = %s
    float[] widths = [0.01]
}
"""
# Centers of a tube's first and last ring, from the definitions of the bases.
ENDS = [
    ("bezier", "nonperiodic", [(0, 0, 0), (1, 3, 0), (3, 3, 0), (4, 0, 0)], (0, 0, 0), (4, 0, 0)),
    ("bspline", "nonperiodic", [(0, 0, 0), (6, 0, 0), (6, 6, 0), (0, 6, 0)], (5, 1, 0), (5, 5, 0)),
    ("bspline", "pinned", [(0, 0, 0), (6, 0, 0), (6, 6, 0), (0, 6, 0)], (0, 0, 0), (0, 6, 0)),
    ("catmullRom", "nonperiodic", [(0, 0, 0), (6, 0, 0), (6, 6, 0), (0, 6, 0)], (6, 0, 0), (6, 6, 0)),
    ("catmullRom", "pinned", [(0, 0, 0), (6, 0, 0), (6, 6, 0), (0, 6, 0)], (0, 0, 0), (0, 6, 0)),
]


@pytest.mark.parametrize(("basis", "wrap", "points", "first", "last"), ENDS)
def test_cubic_curves_begin_and_end_where_their_basis_says(tmp_path, basis, wrap, points, first, last):
    (mesh,) = read(tmp_path, CUBIC % (basis, wrap, len(points), points)).meshes
    caps = mesh.positions[-16:]
    np.testing.assert_allclose(caps[:8].mean(axis=0), first, atol=1e-5)
    np.testing.assert_allclose(caps[8:].mean(axis=0), last, atol=1e-5)


def test_bezier_curve_passes_through_its_midpoint(tmp_path):
    basis, wrap, points, *_ = ENDS[0]
    (mesh,) = read(tmp_path, CUBIC % (basis, wrap, 4, points)).meshes
    rings = mesh.positions[:-16].reshape(-1, 8, 3).mean(axis=1)
    np.testing.assert_allclose(rings[3], (2, 2.25, 0), atol=1e-5)  # t = 1/2 of six steps


UPWARD = [(0, 0, z) for z in range(7)]  # two Bézier segments, four of the other bases
VARYING = [
    ("bezier", "nonperiodic", UPWARD, [1.0, 2.0, 1.0]),
    ("bspline", "nonperiodic", UPWARD, [1.0, 2.0, 3.0, 2.0, 1.0]),
    ("catmullRom", "nonperiodic", UPWARD, [1.0, 2.0, 3.0, 2.0, 1.0]),
    ("bezier", "periodic", [(math.cos(a), math.sin(a), 0.0) for a in np.arange(6) * math.pi / 3.0], [0.1, 0.2]),
]


@pytest.mark.parametrize(("basis", "wrap", "points", "widths"), VARYING)
def test_varying_widths_are_interpolated_between_segment_ends(tmp_path, basis, wrap, points, widths):
    body = (CUBIC % (basis, wrap, len(points), points)).replace("[0.01]", f'{widths} (interpolation = "varying")')
    (mesh,) = read(tmp_path, body).meshes
    positions = mesh.positions if wrap == "periodic" else mesh.positions[:-16]
    rings = positions.reshape(-1, 8, 3)
    wide = 2.0 * np.linalg.norm(rings - rings.mean(axis=1, keepdims=True), axis=-1)
    ends = [*widths, widths[0]] if wrap == "periodic" else widths
    expected = np.interp(np.arange(len(rings)) / 6.0, np.arange(len(ends)), ends)
    np.testing.assert_allclose(wide.min(axis=1), expected, rtol=1e-5)  # rings at bends are wider along one axis


@pytest.mark.parametrize(("basis", "segments"), [("bezier", 2), ("bspline", 6), ("catmullRom", 6)])
def test_periodic_curves_are_closed(tmp_path, basis, segments):
    points = [(math.cos(a), math.sin(a), 0.0) for a in np.arange(6) * math.pi / 3.0]
    (mesh,) = read(tmp_path, CUBIC % (basis, "periodic", 6, points)).meshes
    rings = mesh.positions.reshape(-1, 8, 3)
    assert len(rings) == segments * 6 + 1
    np.testing.assert_allclose(rings[0].mean(axis=0), rings[-1].mean(axis=0), atol=1e-6)


POINTS = """
def Points "P"
{
    point3f[] points = [(0, 0, 0), (5, 0, 0), (9, 9, 9)]
    float[] widths = [2, 4, 0]
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1), (0, 1, 0)] (interpolation = "vertex")
}
"""


def test_points_become_spheres_of_their_widths_and_colors(tmp_path):
    description = read(tmp_path, POINTS)
    (mesh,) = description.meshes
    center = mesh.positions[mesh.triangles].mean(axis=1)
    big = center[:, 0] > 2.0
    colors = np.array([description.materials[row].diffuse_color for row in mesh.materials])
    np.testing.assert_array_equal(colors, np.where(big[:, None], (0, 0, 1), (1, 0, 0)))
    assert volume(mesh.positions, mesh.triangles[~big]) == pytest.approx(4.0 / 3.0 * math.pi, rel=0.005)
    np.testing.assert_allclose(np.linalg.norm(mesh.positions[mesh.triangles[big]] - (5, 0, 0), axis=-1), 2.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (
            STRAIGHT.replace("[2, 3]", "[2, 4]") % ("[1]", ""),
            "</C> curves: curveVertexCounts add up to 6, but it has 5 points",
        ),
        (STRAIGHT.replace("[2, 3]", "[-2, 7]") % ("[1]", COLORS), "</C> curves: curveVertexCounts holds -2"),
        (STRAIGHT % ("[1, 2, 3]", ""), "</C> curves: 3 widths fit neither 2 curves nor their points"),
        (STRAIGHT.replace("(7, 0, 0)", "(nan, 0, 0)") % ("[1]", ""), "</C> curves: a point is not a finite number"),
        (STRAIGHT % ("[1, inf]", ""), "</C> curves: a width is not a finite number"),
        (
            STRAIGHT % ("[1]", "normal3f[] normals = [(0, nan, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]"),
            "</C> curves: a normal is not a finite number",
        ),
        (POINTS.replace("[2, 4, 0]", "[2, 4]"), "</P> points: 2 widths, but 3 points"),
        (POINTS.replace("(9, 9, 9)", "(9, 9, inf)"), "</P> points: a point or width is not a finite number"),
    ],
)
def test_contradictory_curves_and_points_are_problems(tmp_path, body, expected):
    (problem,) = problems_of(tmp_path, body)
    assert problem.startswith(expected)


def test_approximated_curves_and_points_are_reported(tmp_path):
    thin = read_with_warning(tmp_path, STRAIGHT.replace("float[] widths = %s", "") % "", "curves without widths.*</C>")
    assert len(thin.instances) == 1
    read_with_warning(tmp_path, POINTS.replace("float[] widths = [2, 4, 0]", ""), "points without widths.*</P>")
    read_with_warning(
        tmp_path, CUBIC % ("bspline", "nonperiodic", 2, [(0, 0, 0), (1, 0, 0)]), "too short for their basis"
    )
    read_with_warning(tmp_path, 'def Points "P"\n{\n}', "Points without anything to draw: </P>")


def test_primvar_named_widths_takes_precedence_on_points_and_plays(tmp_path):
    line = "    float[] primvars:widths.timeSamples = { 0: [1, 1, 1], 9: [3, 3, 3] }\n    color3f"
    (mesh,) = read(tmp_path, POINTS.replace("    color3f", line)).meshes
    first, last = np.ptp(mesh.deformation.positions, axis=1)
    np.testing.assert_allclose(last - first, 2.0, atol=0.1)


@pytest.mark.parametrize("line", ["point3f[] points", "float[] widths"])
def test_points_with_time_samples_deform(tmp_path, line):
    kind = line.split(" ")[1]
    value = "[(0, 0, 0), (1, 0, 0), (2, 0, 0)]" if kind == "points" else "[1, 1, 1]"
    body = POINTS.replace(
        "    color3f", f"    {line}.timeSamples = {{ 0: {value}, 9: {value.replace('1', '3')} }}\n    color3f"
    )
    (mesh,) = read(tmp_path, body).meshes
    grown = np.ptp(mesh.deformation.positions[1], axis=0) - np.ptp(mesh.deformation.positions[0], axis=0)
    assert grown[0] > 0.9
    assert (grown[1] > 0.9) == (kind == "widths")


@pytest.mark.parametrize(
    "normals", ["", "normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1)]"]
)
def test_colors_vary_along_curves(tmp_path, normals):
    """Red at z = 0 to blue at z = 4; black, white and green at x = 5, 6, 7."""
    colors = "[(1, 0, 0), (0, 0, 1), (0, 0, 0), (1, 1, 1), (0, 1, 0)]"
    lines = f'color3f[] primvars:displayColor = {colors} (interpolation = "vertex")\n{normals}'
    description = read(tmp_path, STRAIGHT % ("[1]", lines))
    (mesh,) = description.meshes
    (material,) = {description.materials[row] for row in mesh.materials}
    assert material.name == "displayColor"
    first = mesh.positions[:, 0] < 2.0
    at = np.where(first, 0.25 * mesh.positions[:, 2], mesh.positions[:, 0] - 5.0).clip(0.0, None)
    expected = np.where(
        first[:, None],
        np.stack([1.0 - at, 0.0 * at, at], axis=-1),
        np.stack([np.interp(at, (0, 1, 2), (0, 1, each)) for each in (0, 1, 0)], axis=-1),
    )
    np.testing.assert_allclose(mesh.colors[:, :3], expected, atol=1e-6)
    np.testing.assert_array_equal(mesh.colors[:, 3], 1.0)


def test_cubic_curves_have_colors_and_opacities_of_their_own_interpolation(tmp_path):
    body = CUBIC % ("bezier", "nonperiodic", 7, [(x, 0, 0) for x in range(7)])
    lines = """color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (interpolation = "varying")
    float[] primvars:displayOpacity = [0, 0, 0, 0.5, 1, 1, 1] (interpolation = "vertex")
}"""
    (mesh,) = read(tmp_path, body.rstrip().removesuffix("}") + lines).meshes
    rings = mesh.positions[: 13 * 8].reshape(13, 8, 3)[:, :, 0].mean(axis=1)
    colors = mesh.colors[: 13 * 8].reshape(13, 8, 4)[:, 0]
    np.testing.assert_allclose(colors[:, 1], 1.0 - np.abs(rings - 3.0) / 3.0, atol=1e-6)
    np.testing.assert_allclose(colors[[0, 6, 12], 3], (0.0, 0.5, 1.0), atol=1e-6)


def test_colors_that_do_not_fit_curves_are_named(tmp_path):
    lines = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")'
    description = read_with_warning(
        tmp_path, STRAIGHT % ("[1]", lines), "3 values fit neither 2 curves nor their points"
    )
    np.testing.assert_allclose(description.meshes[0].colors[:, :3], 0.18)


LINES = """
def BasisCurves "C"
{
    uniform token type = "linear"
    uniform token wrap = "%s"
    int[] curveVertexCounts = [%d]
    point3f[] points = %s
    float[] widths = [0.1] (interpolation = "constant")
    %s
}
"""
BENT = {
    "zigzag": [(-1, 0, 0), (-0.2, 1, 0), (0.2, 0, 0), (1, 1, 0)],
    "corner": [(0, 0, 0), (1, 0, 0), (1, 1, 0)],
    "hairpin": [(0, 0, 0), (1, 0, 0), (0, 0.01, 0)],
    "back": [(0, 0, 0), (1, 0, 0), (0.2, 0, 0)],
    "arc": [(math.cos(a), math.sin(a), 0.1 * a) for a in (0.0, 0.4, 0.8, 1.2, 1.6, 2.0)],
    "repeated": [(0, 0, 0), (0, 0, 0), (1, 0, 0), (1, 0, 0), (1, 1, 0)],
}


@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic"])
@pytest.mark.parametrize("name", BENT)
def test_bent_lines_have_their_width_along_all_of_each_segment(tmp_path, name, wrap, normals):
    """They were narrower at bends, from one end of a segment to the other."""
    points = np.array(BENT[name], float)
    upward = f"normal3f[] normals = {[(0, 0, 1)] * len(points)}" if normals else ""
    (mesh,) = read(tmp_path, LINES % (wrap, len(points), BENT[name], upward)).meshes
    corners = mesh.positions[mesh.triangles].astype(float)
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    for a, b in itertools.pairwise([*points, points[0]] if wrap == "periodic" else points):
        length = np.linalg.norm(b - a)
        if length > 0.2:
            off = (corners - a) - np.einsum("tcj,j,k->tck", corners - a, b - a, b - a) / length**2
            on_it = (np.abs(np.linalg.norm(off, axis=-1) - 0.05) < 1e-6).all(axis=1)
            whole = 0.1 if normals else 0.8 * math.sin(math.pi / 8.0)  # an octagon's circumference
            assert areas[on_it].sum() > 0.95 * whole * length


def swinging(ends, more=""):
    """A line from the origin, or from elsewhere, to an end at each of some time codes."""
    samples = ", ".join(f"{code}: [{tuple(start)}, {tuple(end)}]" for code, (start, end) in ends.items())
    return (LINES % ("nonperiodic", 2, "[]", more)).replace("points = []", f"points.timeSamples = {{ {samples} }}")


@pytest.mark.parametrize("is_ribbon", [False, True])
def test_curves_keep_their_width_where_they_turn_between_samples(tmp_path, is_ribbon):
    upward = "[(0, 1, 0), (0, 1, 0)]"
    normals = f"normal3f[] normals.timeSamples = {{ 0: {upward}, 10: {upward.replace('1', '2')} }}" if is_ribbon else ""
    body = swinging({0: ((0, 0, 0), (1, 0.2, 0)), 10: ((0, 0, 0), (0, 0.2, 1))}, normals)
    (mesh,) = read(tmp_path, body, more=RANGE).meshes
    for t in (0.0, 0.3, 0.45, 1.0):
        axis = np.array((1.0 - t, 0.2, t)) / np.linalg.norm((1.0 - t, 0.2, t))
        points = mesh.deformation.at(t)[0]
        radii = np.linalg.norm(points - np.outer(points @ axis, axis), axis=1)
        np.testing.assert_allclose(radii, 0.05, rtol=1e-2)


@pytest.mark.parametrize(("end", "samples"), [((2, 3, 0), 2), ((1, 3.2, 0), 5)])
def test_curves_have_only_as_many_samples_as_they_turn(tmp_path, end, samples):
    """Not one at each of many time codes: 11° in 8000 of them are four steps."""
    body = swinging({0: ((0, 0, 0), (1, 0, 0)), 8000: ((0, 3, 0), end)})
    assert len(read(tmp_path, body, more=RANGE).meshes[0].deformation.times) == samples


def test_sides_of_tubes_do_not_jump_from_sample_to_sample(tmp_path):
    """The first side is across the axis that the curve follows least, which is another one after a turn of 45°."""
    ends = {k: ((0, 0, 0), (math.cos(0.1 * k), 0.9, math.sin(0.1 * k))) for k in range(11)}
    (mesh,) = read(tmp_path, swinging(ends), more=RANGE).meshes
    steps = np.linalg.norm(np.diff(mesh.deformation.positions, axis=0), axis=2)
    assert steps.max() < 0.1 + 0.05 * 0.1


def test_spheres_of_points_are_finer_the_fewer_they_are(tmp_path):
    """A single one was of 80 triangles, 8 % smaller in the picture than a Sphere."""
    counts = []
    for number in (1, 100, 500, 5000):
        points = [(3 * k, 0, 0) for k in range(number)]
        (mesh,) = read(tmp_path, f'def Points "P"\n{{\npoint3f[] points = {points}\nfloat[] widths = [1.6]\n}}').meshes
        counts.append(len(mesh.triangles) // number)
        if number == 1:
            flat = mesh.positions * (1.0, 1.0, 0.0)
            silhouette = 0.5 * area(flat, mesh.triangles)  # both sides
            assert silhouette == pytest.approx(math.pi * 0.8**2, rel=0.003)
    assert counts == [5120, 1280, 320, 80]


@pytest.mark.parametrize(
    ("wrap", "points", "unused"), [("nonperiodic", 5, 1), ("nonperiodic", 6, 2), ("periodic", 7, 1)]
)
def test_points_that_no_segment_of_a_bezier_curve_has_are_reported(tmp_path, wrap, points, unused):
    line = [(k, k * k, 0) for k in range(points)]
    description = read_with_warning(
        tmp_path, CUBIC % ("bezier", wrap, points, line), f"bezier curves of {points} points.*without the last {unused}"
    )
    if wrap == "periodic":
        rings = description.meshes[0].positions.reshape(-1, 8, 3)
        np.testing.assert_allclose(rings[0].mean(axis=0), rings[-1].mean(axis=0), atol=1e-5)

# SPDX-License-Identifier: Apache-2.0
"""Catmull-Clark subdivision against hand-computed values and against its own limit positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.usd.helpers import area, facing, read, volume
from tiscene.usd.geometry.catmull_clark import Cage, Creases, limit, refine
from tiscene.usd.geometry.primvar import Topology
from tiscene.usd.geometry.subdivision import subdivide
from tiscene.usd.geometry.vertex_weld import Attribute

POINTS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float32)
FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE = Topology(8, np.full(6, 4, np.int32), np.array(FACES, np.int32).reshape(-1))
TOP_LOOP = np.array([[2, 3], [3, 7], [7, 6], [6, 2]])  # the edges of the face y = 1
ALL = np.ones(6, dtype=bool)


def cage_of(topology: Topology, edges=(), sharpness=0.0) -> Cage:
    cage = Cage(
        topology.counts.astype(int),
        topology.indices.astype(int),
        np.zeros(len(topology.indices)),
        np.zeros(topology.points),
    )
    ends = {frozenset(edge) for edge in np.asarray(edges).tolist()}
    sharp = [
        sharpness if frozenset((int(a), int(b))) in ends else 0.0
        for a, b in zip(cage.indices, cage.indices[cage.following], strict=True)
    ]
    return Cage(cage.counts, cage.indices, np.array(sharp), cage.point_sharpness)


def grid(n: int) -> tuple[np.ndarray, Topology]:
    """Return n x n quadrilaterals on the unit square."""
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    points = np.stack([x.ravel() / n, y.ravel() / n, np.zeros((n + 1) ** 2)], axis=-1).astype(np.float32)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1)
    indices = np.stack([corner, corner + 1, corner + n + 2, corner + n + 1], axis=-1)
    return points, Topology(len(points), np.full(n * n, 4, np.int32), indices.reshape(-1).astype(np.int32))


def test_one_refinement_of_cube_matches_hand_computed_values():
    child, values = refine(cage_of(CUBE), POINTS.astype(float))
    np.testing.assert_allclose(np.abs(values[:8]), 5.0 / 9.0)
    edge_points = values[8:20]
    np.testing.assert_allclose(np.sort(np.abs(edge_points), axis=1), np.tile([0, 0.75, 0.75], (12, 1)), atol=1e-12)
    np.testing.assert_allclose(np.sort(np.abs(values[20:]), axis=1), np.tile([0, 0, 1], (6, 1)), atol=1e-12)
    assert len(child.counts) == 24
    assert (child.counts == 4).all()


def test_limit_of_cube_matches_hand_computed_value():
    child, values = refine(cage_of(CUBE), POINTS.astype(float))
    # Valence 3: (9 · 5/9 + 4 · (0 + 3/4 + 3/4) + (1 + 0 + 0)) / (3 · 8)
    np.testing.assert_allclose(np.abs(limit(child, values)[:8]), 0.5)


@pytest.mark.parametrize("sharpness", [0.0, np.inf])
def test_limit_is_the_same_at_every_level(sharpness):
    cage, values = cage_of(CUBE, TOP_LOOP, sharpness), POINTS.astype(float)
    cage, values = refine(cage, values)
    early = limit(cage, values)
    for _ in range(3):
        cage, values = refine(cage, values)
        np.testing.assert_allclose(limit(cage, values)[: len(early)], early, atol=1e-12)


def test_limit_of_boundary_is_the_same_at_every_level():
    points, topology = grid(3)
    values = points.astype(float)
    values[:, 2] = np.sin(5.0 * values[:, 0]) * values[:, 1]
    cage = cage_of(topology).with_boundary_corners_sharp()
    cage, values = refine(cage, values)
    early = limit(cage, values)
    cage, values = refine(*refine(cage, values))
    np.testing.assert_allclose(limit(cage, values)[: len(early)], early, atol=1e-12)


def test_infinite_crease_is_refined_as_a_curve():
    _, values = refine(cage_of(CUBE, TOP_LOOP, np.inf), POINTS.astype(float))
    np.testing.assert_allclose(values[[2, 3, 6, 7], 1], 1.0)  # the loop stays in its plane
    np.testing.assert_allclose(np.abs(values[[2, 3, 6, 7]][:, [0, 2]]), 0.75)  # (6·1 + 1 - 1) / 8


def test_three_sharp_edges_make_a_corner_and_one_a_dart():
    _, corner = refine(cage_of(CUBE, [[0, 1], [0, 2], [0, 4]], np.inf), POINTS.astype(float))
    np.testing.assert_allclose(corner[0], POINTS[0])
    _, dart = refine(cage_of(CUBE, [[0, 1]], np.inf), POINTS.astype(float))
    np.testing.assert_allclose(np.abs(dart[0]), 5.0 / 9.0)


def test_edge_sharpness_of_half_is_halfway_between_smooth_and_sharp():
    smooth = refine(cage_of(CUBE), POINTS.astype(float))[1]
    sharp = refine(cage_of(CUBE, TOP_LOOP, np.inf), POINTS.astype(float))[1]
    half = refine(cage_of(CUBE, TOP_LOOP, 0.5), POINTS.astype(float))[1]
    np.testing.assert_allclose(half, (smooth + sharp) / 2.0, atol=1e-12)


def test_point_sharpness_of_half_is_halfway_between_smooth_and_sharp():
    def corner(sharpness: float) -> np.ndarray:
        cage = cage_of(CUBE)
        return refine(replace(cage, point_sharpness=np.where(np.arange(8) == 1, sharpness, 0.0)), POINTS.astype(float))[
            1
        ]

    np.testing.assert_allclose(corner(np.inf)[1], POINTS[1])
    np.testing.assert_allclose(corner(0.5), (corner(0.0) + corner(np.inf)) / 2.0, atol=1e-12)


def test_sharpness_decreases_by_one_per_level():
    cage, values = cage_of(CUBE, TOP_LOOP, 2.0), POINTS.astype(float)
    infinite, infinite_values = cage_of(CUBE, TOP_LOOP, np.inf), POINTS.astype(float)
    for level in range(3):
        assert cage.sharpness.max() == max(2.0 - level, 0.0)
        cage, values = refine(cage, values)
        infinite, infinite_values = refine(infinite, infinite_values)
        assert np.allclose(values, infinite_values) == (level < 2)


def test_smooth_cube_is_closed_with_outward_normals():
    surface = subdivide(POINTS, CUBE, Creases.none(), ALL, None)
    assert len(surface.positions) == len(np.unique(surface.positions, axis=0))
    outward = surface.positions / np.linalg.norm(surface.positions, axis=1)[:, None]
    assert np.einsum("ij,ij->i", outward, surface.normals).min() > 0.97
    assert np.abs(np.linalg.norm(surface.normals, axis=1) - 1.0).max() < 1e-6
    assert 0.0 < volume(surface.positions, surface.triangles) < 8.0


def test_fully_creased_cube_stays_a_cube_with_split_normals():
    edges = np.array([[0, 1], [1, 3], [3, 2], [2, 0], [4, 6], [6, 7], [7, 5], [5, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
    creases = Creases(edges, np.full(12, np.inf), np.empty(0, int), np.empty(0))
    surface = subdivide(POINTS, CUBE, creases, ALL, None)
    assert volume(surface.positions, surface.triangles) == pytest.approx(8.0)
    assert area(surface.positions, surface.triangles) == pytest.approx(24.0)
    np.testing.assert_allclose(np.sort(np.abs(surface.normals), axis=1)[:, :2], 0.0, atol=1e-6)
    np.testing.assert_allclose(surface.normals[surface.triangles[:, 0]], facing(surface.positions, surface.triangles))


@pytest.mark.parametrize(("boundary", "expected"), [("edgeAndCorner", 1.0), ("none", 1.0 / 9.0)])
def test_boundary_rules_of_flat_grid(boundary, expected):
    points, topology = grid(3)
    surface = subdivide(points, topology, Creases.none(), np.ones(9, bool), None, boundary=boundary)
    assert area(surface.positions, surface.triangles) == pytest.approx(expected, rel=0.06)
    np.testing.assert_allclose(surface.normals, np.tile([0, 0, 1], (len(surface.normals), 1)), atol=1e-6)
    if boundary == "edgeAndCorner":
        corners = {(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)}
        assert corners <= {tuple(p) for p in surface.positions[:, :2].tolist()}


def test_edge_only_boundary_rounds_corners():
    points, topology = grid(3)
    sharp = subdivide(points, topology, Creases.none(), np.ones(9, bool), None)
    round_ = subdivide(points, topology, Creases.none(), np.ones(9, bool), None, boundary="edgeOnly")
    assert area(round_.positions, round_.triangles) < area(sharp.positions, sharp.triangles) - 0.01


def test_holes_are_not_drawn_but_shape_their_neighbors():
    visible = ALL.copy()
    visible[3] = False
    whole = subdivide(POINTS, CUBE, Creases.none(), ALL, None)
    open_ = subdivide(POINTS, CUBE, Creases.none(), visible, None)
    assert 3 not in open_.face
    assert set(open_.face.tolist()) == {0, 1, 2, 4, 5}
    kept = {tuple(p) for p in open_.positions.tolist()}
    assert kept < {tuple(p) for p in whole.positions.tolist()}


@pytest.mark.parametrize("rule", ["none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all"])
def test_uv_of_sheet_without_seams_stays_in_unit_square(rule):
    points, topology = grid(2)
    per_corner = points[topology.indices][:, :2].copy()
    surface = subdivide(points, topology, Creases.none(), np.ones(4, bool), Attribute(per_corner, True), uv_rule=rule)
    assert surface.uv.min() >= -1e-6
    assert surface.uv.max() <= 1.0 + 1e-6
    if rule not in ("none", "all"):  # uv is refined exactly as the points
        np.testing.assert_allclose(surface.uv, surface.positions[:, :2], atol=1e-6)
    if rule == "all":
        assert {(0.25, 0.25), (0.5, 0.5), (1.0, 1.0)} <= {tuple(uv) for uv in surface.uv.tolist()}


def test_uv_seam_keeps_each_side_in_its_range():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    uv = Attribute(np.tile(square, (6, 1)), per_corner=True)  # each face of the cube has the whole image
    surface = subdivide(POINTS, CUBE, Creases.none(), ALL, uv)
    for face in range(6):
        used = surface.uv[surface.triangles[surface.face == face]].reshape(-1, 2)
        np.testing.assert_allclose([used.min(axis=0), used.max(axis=0)], [[0, 0], [1, 1]], atol=1e-6)


def test_vertex_uv_is_refined_as_the_points():
    uv = Attribute(POINTS[:, :2].copy(), per_corner=False)
    surface = subdivide(POINTS, CUBE, Creases.none(), ALL, uv)
    np.testing.assert_allclose(surface.uv, surface.positions[:, :2], atol=1e-6)


@pytest.mark.parametrize(("interpolation", "expected"), [("varying", 1.0), ("vertex", 4.0 / 9.0)])
def test_varying_uv_is_linear_over_each_face(tmp_path, interpolation, expected):
    """A flat sheet of 2x2 faces whose texture coordinates are 1 at its center and 0 around."""
    points, topology = grid(2)
    center = np.abs(points[:, :2] - points[:, :2].mean(axis=0)).max(axis=1) < 1e-6
    st = ", ".join("(1, 1)" if each else "(0, 0)" for each in center)
    body = f"""def Mesh "M"
{{
    point3f[] points = {[tuple(point) for point in points.tolist()]}
    int[] faceVertexCounts = {topology.counts.tolist()}
    int[] faceVertexIndices = {topology.indices.tolist()}
    texCoord2f[] primvars:st = [{st}] (interpolation = "{interpolation}")
}}"""
    (mesh,) = read(tmp_path, body).meshes
    distance = np.abs(mesh.positions[:, :2] - points[center][0, :2])
    at_center = distance.max(axis=1) < 1e-6
    np.testing.assert_allclose(mesh.uv[at_center], expected, atol=1e-6)
    if interpolation == "varying":
        size = np.ptp(points[:, 0]) / 2.0
        np.testing.assert_allclose(mesh.uv[:, 0], (1.0 - distance / size).prod(axis=1), atol=1e-5)


def test_triangles_and_n_gons_become_quadrilaterals():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32)
    tetrahedron = Topology(4, np.full(4, 3, np.int32), np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], np.int32))
    child, values = refine(cage_of(tetrahedron), points.astype(float))
    assert len(child.counts) == 12
    np.testing.assert_allclose(values[-4:], points[tetrahedron.indices].reshape(4, 3, 3).mean(axis=1), atol=1e-7)
    surface = subdivide(points, tetrahedron, Creases.none(), np.ones(4, bool), None)
    assert 0.0 < volume(surface.positions, surface.triangles) < 1.0 / 6.0


def test_faces_of_two_corners_are_ignored():
    topology = Topology(8, np.append(CUBE.counts, 2).astype(np.int32), np.append(CUBE.indices, [0, 1]).astype(np.int32))
    surface = subdivide(POINTS, topology, Creases.none(), np.ones(7, bool), None)
    assert volume(surface.positions, surface.triangles) == pytest.approx(
        volume(*(lambda s: (s.positions, s.triangles))(subdivide(POINTS, CUBE, Creases.none(), ALL, None)))
    )


def test_dense_mesh_is_not_refined(monkeypatch):
    monkeypatch.setattr("tiscene.usd.geometry.subdivision.MAX_QUADS", 20)
    surface = subdivide(POINTS, CUBE, Creases.none(), ALL, None)
    assert len(surface.triangles) == 12
    np.testing.assert_allclose(np.abs(surface.normals), 1.0 / np.sqrt(3.0), atol=1e-6)

# SPDX-License-Identifier: Apache-2.0
"""Hits equal those of Embree and of brute force; ties, degenerate geometry and reproducibility are exact."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from tests.reference.ray_casting import cast
from tests.render.tracing import (
    Traced,
    compiled_kernels,
    described,
    mesh,
    placed,
    random_matrices,
    random_rays,
    rays_of,
    scene_of,
    sentinel_hits,
    shape,
    soup,
    trace_rays,
)
from tiscene.device.memory import device_array, upload, upload_vectors
from tiscene.errors import ArgumentError
from tiscene.render.intersect import bvh2, bvh8, bvh8_any_hit, trace
from tiscene.scene.bvh import workspace
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

SQUARE = mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
ROOT = Path(__file__).parents[3]

both_layouts = pytest.mark.parametrize("traversal", ["bvh8", "bvh2"])


def clutter(traversal: str = "bvh8") -> tuple[DeviceScene, np.ndarray, tuple]:
    """Return a scene of sixty scaled, mirrored, overlapping meshes, 20 000 rays, and (meshes, placement)."""
    random = np.random.default_rng(5)
    meshes = tuple(
        shape(made)
        for made in (
            trimesh.creation.icosphere(subdivisions=3),
            trimesh.creation.box(),
            trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12),
        )
    )
    placement = placed(np.arange(60) % 3, random_matrices(random, 60, 4.0))
    return scene_of(meshes, placement, traversal), random_rays(random, 20_000, 6.0), (meshes, placement)


def traced_clutter() -> Traced:
    scene, rays, _ = clutter()
    return trace_rays(scene, rays)


@both_layouts
def test_agrees_with_embree(traversal: str) -> None:
    scene, rays, (meshes, placement) = clutter(traversal)
    corners, owners = [], []
    for instance, row in enumerate(placement.mesh):
        matrix = placement.world_from_object[CURRENT, instance]
        corners.append((meshes[row].positions @ matrix[:, :3].T + matrix[:, 3])[meshes[row].triangles])
        owners += [instance] * len(corners[-1])
    embree = EmbreeScene()
    TriangleMesh(embree, np.concatenate(corners).astype(np.float32))
    expected = embree.run(rays[:, :3].copy(), rays[:, 4:7].copy(), output=True)
    instance = np.where(expected["primID"] >= 0, np.array(owners)[expected["primID"]], -1)
    found = trace_rays(scene, rays)
    same = found.instance == instance
    assert same.mean() >= 0.999
    hit = same & (instance >= 0)
    assert hit.sum() > 8000
    assert (np.abs(found.t[hit] / expected["tfar"][hit] - 1.0) < 1e-4).mean() >= 0.999


@both_layouts
def test_agrees_with_brute_force(traversal: str) -> None:
    random = np.random.default_rng(1)
    centers = random.uniform(-2.0, 2.0, (200, 1, 3))
    meshes = (soup(centers + random.normal(0.0, 0.6, (200, 3, 3))), SQUARE)
    placement = placed([0, 1, 0], random_matrices(random, 3, 1.0))
    rays = random_rays(random, 3000, 4.0)
    rays[::3, 7] = random.uniform(0.0, 3.0, 1000)
    expected = cast(meshes, placement, rays)
    found = trace_rays(scene_of(meshes, placement, traversal), rays)
    same = (found.instance == expected.instance) & (found.triangle == expected.triangle)
    assert same.mean() >= 0.999
    hit = same & (expected.instance >= 0)
    assert hit.sum() > 500
    np.testing.assert_allclose(found.t[hit], expected.t[hit], rtol=2e-4)
    assert (found.t[expected.instance < 0] == np.inf).mean() >= 0.999


def test_barycentrics_interpolate_hit_point() -> None:
    scene, rays, (_, placement) = clutter()
    found = trace_rays(scene, rays)
    hit = found.instance >= 0
    b1, b2 = found.barycentrics[hit].T.astype(np.float64)
    assert min(b1.min(), b2.min(), (1.0 - b1 - b2).min()) >= -1e-6
    positions = scene.vertex_position.to_numpy()[scene.triangle_vertices.to_numpy()[found.triangle[hit]]]
    point = np.einsum("nc,ncx->nx", np.stack([1.0 - b1 - b2, b1, b2], axis=1), positions.astype(np.float64))
    matrix = placement.world_from_object[CURRENT][found.instance[hit]]
    world = np.einsum("nij,nj->ni", matrix[:, :, :3], point) + matrix[:, :, 3]
    along = rays[hit, :3] + found.t[hit, None].astype(np.float64) * rays[hit, 4:7]
    assert np.abs(world - along).max() < 2e-4
    assert np.quantile(np.abs(world - along), 0.99) < 5e-6


def test_bvh8_and_bvh2_agree_bitwise() -> None:
    for eight, two in zip(traced_clutter(), trace_rays(*clutter("bvh2")[:2]), strict=True):
        np.testing.assert_array_equal(eight, two)


@both_layouts
def test_occlusion_agrees_with_closest_hit(traversal: str) -> None:
    scene, rays, _ = clutter(traversal)
    found = trace_rays(scene, rays)
    np.testing.assert_array_equal(found.occluded, found.instance >= 0)
    hit = found.instance >= 0
    rays[hit, 7] = found.t[hit]  # t_max is excluded
    nearer = trace_rays(scene, rays)
    assert not nearer.occluded.any()
    assert (nearer.instance == -1).all()
    assert (nearer.triangle == -1).all()
    assert (nearer.t == np.inf).all()
    rays[hit, 7] = np.nextafter(found.t[hit], np.float32(np.inf))
    np.testing.assert_array_equal(trace_rays(scene, rays).occluded, hit)


@both_layouts
def test_lowest_ids_win_ties(traversal: str) -> None:
    double = mesh(SQUARE.positions, [[0, 1, 2], [0, 2, 3]] * 40)  # 40 coincident squares in one mesh
    random = np.random.default_rng(2)
    rays = rays_of(np.column_stack([random.uniform(-0.9, 0.9, (500, 2)), np.full(500, 3.0)]), [0.0, 0.0, -1.0])
    below_diagonal = rays[:, 0] >= rays[:, 1]
    found = trace_rays(scene_of((double,), placed([0] * 30), traversal), rays)
    assert (found.instance == 0).all()
    np.testing.assert_array_equal(found.triangle, np.where(below_diagonal, 0, 1))
    present = np.ones((3, 30), bool)
    present[:, :17] = False
    found = trace_rays(scene_of((SQUARE, double), placed([0, 1] * 15, present=present), traversal), rays)
    assert (found.instance == 17).all()
    np.testing.assert_array_equal(found.triangle, np.where(below_diagonal, 2, 3))


@both_layouts
def test_shared_edges_and_vertices_have_no_gaps(traversal: str) -> None:
    """Rays down to the vertices and edges of a grid: no gap, and the lowest triangle at the point wins."""
    size = 33
    y, x = np.mgrid[0:size, 0:size]
    positions = np.column_stack([x.ravel() - 16.0, y.ravel() - 16.0, np.zeros(size * size)])
    corner = (y[:-1, :-1] * size + x[:-1, :-1]).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + size + 1], axis=1),
            np.stack([corner, corner + size + 1, corner + size], axis=1),
        ]
    )
    grid = mesh(positions, faces)
    inner = positions[(np.abs(positions[:, :2]) < 16).all(axis=1)]
    shifts = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.0], [0.0, 0.5, 2.0]])
    origins = (inner[None] + shifts[:, None]).reshape(-1, 3)
    rays = rays_of(origins, [0.0, 0.0, -1.0])
    found = trace_rays(scene_of((grid,), placed([0]), traversal), rays)
    corners = positions[faces]
    touches = (
        (origins[:, None, :2] >= corners[None, :, :, :2].min(axis=2))
        & (origins[:, None, :2] <= corners[None, :, :, :2].max(axis=2))
    ).all(axis=2)
    local = origins[:, None, :2] - corners[None, :, 0, :2]
    lower = np.arange(len(faces)) < len(faces) // 2
    touches &= np.where(lower, local[..., 0] >= local[..., 1], local[..., 0] <= local[..., 1])
    assert (found.t == 2.0).all()
    np.testing.assert_array_equal(found.triangle, touches.argmax(axis=1))


def closed_meshes() -> dict[str, trimesh.Trimesh]:
    """Return watertight meshes around the origin, with slivers and tiny triangles."""
    box = trimesh.creation.box((3.0, 2.0, 2.5))
    bevelled = trimesh.convex.convex_hull(  # edges a hundredth of a millimeter wide
        (box.vertices[:, None] - 1e-5 * np.sign(box.vertices)[:, None] * (1.0 - np.eye(3))).reshape(-1, 3)
    )
    split = trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(box.vertices, box.faces, 0.4), process=False)
    needles = trimesh.creation.icosphere(subdivisions=3, radius=0.7)
    needles.apply_scale((1.0, 1.0, 1e-4)).apply_translation((0.1, -0.2, 1e-5))
    seam = trimesh.Trimesh(  # collinear triangles close the T-junctions of an edge
        [[-1, -1, -1], [1, -1, -1], [0, 1, -1], [0, 0, 1], [-0.37, -1, -1], [0.41, -1, -1]],
        [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        process=False,
    )
    faces = [[0, 2, 1], [0, 4, 3], [4, 5, 3], [5, 1, 3], [0, 1, 4], [4, 1, 5], [1, 2, 3], [2, 0, 3]]
    seam = trimesh.Trimesh(seam.vertices, faces, process=False)
    return {"bevelled": bevelled, "split": split, "needles": needles, "seam": seam}


@both_layouts
@pytest.mark.parametrize("name", closed_meshes())
def test_no_ray_leaves_a_watertight_mesh(traversal: str, name: str) -> None:
    """Rays from inside to points on edges and to vertices, as exactly as float32 can aim."""
    made = closed_meshes()[name]
    assert made.is_watertight
    random = np.random.default_rng(4)
    turned = random_matrices(random, 1, 0.0)
    turned[:, :, 3] = (0.3, -2.0, 1.1)
    scene = scene_of((shape(made),), placed([0], turned), traversal)
    start = made.vertices[made.edges[:, 0]]
    part = random.random((40, len(start), 1)) * (random.random((40, len(start), 1)) > 0.1)
    targets = (start + part * (made.vertices[made.edges[:, 1]] - start)).reshape(-1, 3)
    inside = 0.05 * random.uniform(-1.0, 1.0, (len(targets), 3)) * np.abs(made.vertices).max(axis=0)
    origins, targets = (points @ turned[0, :, :3].T + turned[0, :, 3] for points in (inside, targets))
    found = trace_rays(scene, rays_of(origins, targets - origins))
    assert (found.instance == 0).all()
    assert found.occluded.all()
    assert (np.abs(found.t - 1.0) < 2e-2).mean() > 0.99


@both_layouts
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_axis_aligned_rays_in_box_planes_agree_with_brute_force(traversal: str, axis: int, sign: float) -> None:
    """Directions with two zero components (of both signs), origins exactly in the planes of the boxes."""
    box = shape(trimesh.creation.box((2.0, 2.0, 2.0)))
    scene = scene_of((box,), placed([0]), traversal)
    others = np.stack(np.meshgrid([-1.0, -0.5, 0.25, 1.0], [-1.0, 0.0, 0.5, 1.0]), axis=-1).reshape(-1, 2)
    for zero in (0.0, -0.0):
        origins = np.insert(others, axis, -3.0 * sign, axis=1)
        direction = np.full(3, zero)
        direction[axis] = sign
        found = trace_rays(scene, rays_of(origins, direction))
        assert (found.t == 2.0).all()
        assert found.occluded.all()
        away = trace_rays(scene, rays_of(origins, -direction))
        assert (away.instance == -1).all()


@both_layouts
def test_degenerate_triangles_are_missed(traversal: str) -> None:
    empty = mesh([], [])
    point = mesh(np.zeros((3, 3)), [[0, 1, 2]])
    sliver = mesh([[-1, 0, 0], [1, 0, 0], [0.3, 0, 0]], [[0, 1, 2], [2, 1, 0]])
    one = mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])
    mixed = mesh([*sliver.positions, *one.positions], [[0, 1, 2], [3, 4, 5], [0, 0, 0]])
    same_center = soup([[[-s, -s, 0], [s, -s, 0], [0, 2 * s, 0]] for s in np.arange(1, 51) / 64])
    down = rays_of([[0.0, 0.0, 5.0]], [0.0, 0.0, -1.0])
    for meshes, row, hit in (
        ((empty,), 0, -1),
        ((point,), 0, -1),
        ((sliver,), 0, -1),
        ((one,), 0, 0),
        ((empty, sliver, mixed), 2, 3),
        ((same_center,), 0, 0),
    ):
        found = trace_rays(scene_of(meshes, placed([row]), traversal), down)
        assert found.triangle.tolist() == [hit], meshes
        assert found.occluded.tolist() == [int(hit >= 0)]
    assert trace_rays(scene_of((one,), placed([]), traversal), down).instance.tolist() == [-1]
    assert trace_rays(scene_of((), placed([]), traversal), down).instance.tolist() == [-1]


@both_layouts
def test_flat_and_singular_instances_are_missed(traversal: str) -> None:
    squashed = np.zeros((3, 4))
    squashed[0, 0] = squashed[1, 1] = 1.0
    moved = np.eye(3, 4)
    moved[2, 3] = -1.0
    scene = scene_of((SQUARE,), placed([0, 0, 0], [squashed, moved, np.zeros((3, 4))]), traversal)
    found = trace_rays(scene, rays_of([[0.3, 0.2, 4.0]], [0.0, 0.0, -1.0]))
    assert found.instance.tolist() == [1]
    assert found.t.tolist() == [5.0]


@both_layouts
def test_each_time_has_its_own_instances(traversal: str) -> None:
    matrices = np.zeros((3, 2, 3, 4))
    matrices[..., :3] = np.eye(3)
    matrices[:, 0, 2, 3] = (1.0, 2.0, 3.0)
    present = np.array([[True, True], [True, False], [False, True]])
    scene = scene_of((SQUARE,), placed([0, 0], matrices, present), traversal, times=(PREVIOUS, CURRENT, NEXT))
    ray = rays_of([[0.1, 0.2, 10.0]], [0.0, 0.0, -1.0])
    hits = [
        (float(found.t[0]), int(found.instance[0])) for found in (trace_rays(scene, ray, time) for time in range(3))
    ]
    assert hits == [(9.0, 0), (8.0, 0), (10.0, 1)]


def test_tracing_at_unplaced_time_raises() -> None:
    scene = scene_of((SQUARE,), placed([0]))
    with pytest.raises(ArgumentError, match="place"):
        trace_rays(scene, rays_of([[0, 0, 1]], [0, 0, -1]), NEXT)
    scene.add(described(SQUARE))
    with pytest.raises(ArgumentError, match="place"):
        trace_rays(scene, rays_of([[0, 0, 1]], [0, 0, -1]))


@both_layouts
def test_only_queued_rays_are_written(traversal: str) -> None:
    scene, rays, _ = clutter(traversal)
    rays = rays[:1000]
    everything = trace_rays(scene, rays)
    queue = upload(np.arange(999, -1, -3, dtype=np.int32))
    hits, ids = sentinel_hits(1000)
    trace.closest(scene, CURRENT, upload_vectors(rays), queue, 200, hits, ids)
    queued = np.zeros(1000, bool)
    queued[np.arange(999, -1, -3)[:200]] = True
    np.testing.assert_array_equal(hits.to_numpy()[queued, 0], everything.t[queued])
    np.testing.assert_array_equal(ids.to_numpy()[queued, 1], everything.triangle[queued])
    assert (hits.to_numpy()[~queued] == 7.0).all()
    assert (ids.to_numpy()[~queued] == 7).all()


def test_packets_hit_what_single_rays_hit() -> None:
    """Narrow and wide packets, with and without a common origin, along axes, with misses, with a finite t_max."""
    scene, _, _ = clutter()
    random = np.random.default_rng(15)
    aims = random.normal(size=(600, 1, 3))
    aims /= np.linalg.norm(aims, axis=2, keepdims=True)
    aims[:60] = np.round(3.0 * aims[:60])  # along axes and diagonals, where the largest axis changes within a bundle
    spread = np.where(np.arange(600) < 500, 0.001, 0.3)[:, None, None]
    directions = aims + spread * random.normal(size=(600, 16, 3)) * np.linalg.norm(aims, axis=2, keepdims=True)
    origins = np.repeat(random.uniform(-4.0, 4.0, (600, 1, 3)), 16, axis=1)
    origins[::7] += 0.01 * random.normal(size=(86, 16, 3))
    directions[::50, 3:] = directions[::50, :1]  # the same ray again and again
    rays = rays_of(origins.reshape(-1, 3), directions.reshape(-1, 3))[:-5]
    rays[:, 4:7] /= np.linalg.norm(rays[:, 4:7], axis=1, keepdims=True)
    rays[::3, 7] = random.uniform(0.5, 8.0, len(rays[::3]))
    queue = upload(np.arange(len(rays), dtype=np.int32))
    answers = []
    for together in (False, True):
        hits, ids = sentinel_hits(len(rays))
        trace.closest(scene, CURRENT, upload_vectors(rays), queue, len(rays), hits, ids, coherent=together)
        answers.append((hits.to_numpy(), ids.to_numpy()))
    assert 0.1 < (answers[0][1][:, 0] >= 0).mean() < 0.9
    for alone, together in zip(*answers, strict=True):
        np.testing.assert_array_equal(together, alone)


@both_layouts
def test_occluded_by_instance_ignores_other_instances(traversal: str) -> None:
    scene, rays, (meshes, placement) = clutter(traversal)
    rays = rays[:240]
    targets = np.arange(240, dtype=np.int32) % 12 * 5
    result = device_array(ti.i32, 240)
    queue = upload(np.arange(240, dtype=np.int32))
    trace.occluded_by_instance(scene, upload_vectors(rays), queue, upload(targets), 240, result)
    for target in range(0, 60, 5):
        chosen = targets == target
        alone = placed([placement.mesh[target]], placement.world_from_object[CURRENT, target : target + 1])
        expected = cast(meshes, alone, rays[chosen]).instance >= 0
        np.testing.assert_array_equal(result.to_numpy()[chosen], expected)


def test_traversal_stacks_fit_tree_depths() -> None:
    for kernels, layout in ((bvh8, workspace.BVH8), (bvh2, workspace.BVH2)):
        assert layout.blas_stack + layout.tlas_stack <= kernels.STACK
    assert workspace.BVH8.blas_stack + workspace.BVH8.tlas_stack + 3 <= bvh8_any_hit.GROUPS


@both_layouts
def test_second_scene_compiles_no_kernel(traversal: str) -> None:
    trace_rays(*clutter(traversal)[:2])
    before = compiled_kernels()
    assert before > 0
    random = np.random.default_rng(8)
    ball = shape(trimesh.creation.icosphere(subdivisions=5))  # past the size where a build becomes parallel
    scene = scene_of((ball, SQUARE), placed([0, 1] * 100, random_matrices(random, 200, 3.0)), traversal)
    assert (trace_rays(scene, random_rays(random, 77, 4.0)).instance >= 0).any()
    scene.add(described(SQUARE))
    scene.place(placed([0, 1, 2]), (PREVIOUS, CURRENT, NEXT))
    trace_rays(scene, random_rays(random, 77, 4.0), NEXT)
    assert compiled_kernels() == before


@pytest.mark.parametrize(
    "change",
    ["runtime.start(threads=1)", pytest.param("trace.vector_mode = contextlib.nullcontext", marks=pytest.mark.slow)],
)
def test_same_bytes_in_another_process(change: str, tmp_path: Path) -> None:
    """With one thread, and compiled in scalar instead of vector mode."""
    script = (
        "import contextlib, sys, numpy\n"
        "from tiscene.device import runtime\n"
        "from tiscene.render.intersect import trace\n"
        f"{change}\n"
        "from tests.render.intersect.test_intersect import traced_clutter\n"
        "numpy.savez(sys.argv[1], **traced_clutter()._asdict())\n"
    )
    file = tmp_path / "hits.npz"
    subprocess.run([sys.executable, "-c", script, str(file)], cwd=ROOT, check=True, timeout=300)
    with np.load(file) as other:
        for name, values in traced_clutter()._asdict().items():
            np.testing.assert_array_equal(values, other[name], err_msg=name)

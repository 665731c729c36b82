# SPDX-License-Identifier: Apache-2.0
"""The layout of GPUs needs no kernel that runs in one thread where instances are placed or meshes deform."""

import ast
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import tiscene
from tests.render.tracing import placed, random_matrices, random_rays, scene_of, shape, trace_rays
from tiscene.device.memory import upload
from tiscene.scene.bvh import bvh, instance_tree, layout_kernels
from tiscene.scene.bvh.blas import levels_below
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.instance_tree import InstanceTrees, median_trees, node_count
from tiscene.scene.bvh.workspace import Workspace

Floats = NDArray[np.float32]

ROOT = Path(tiscene.__file__).parents[1]
BALL = shape(trimesh.creation.icosphere(subdivisions=3))
# Kernels with a loop in one thread. `collapse` and `refit_bvh8` belong to builds and to the layout of CPUs; the other
# scans the sums of blocks.
SERIAL = {"collapse", "refit_bvh8", "exclusive_scan"}


def check_trees(
    nodes: Floats,
    numbers: NDArray[np.int64],
    boxes: Floats,
    rows: NDArray[np.int32],
    sizes: list[int],
    roots: list[int],
) -> None:
    """Check that each instance is in one leaf, inside all boxes above it."""
    assert len(set(numbers.tolist())) == len(nodes) == sum(map(node_count, sizes))
    by_number = dict(zip(numbers.tolist(), nodes, strict=True))
    for start, size, root in zip(np.cumsum([0, *sizes[:-1]]).tolist(), sizes, roots, strict=True):
        found, pending = [], [(root, np.full(3, -np.inf), np.full(3, np.inf), 0)]
        while pending:
            number, low, high, depth = pending.pop()
            assert root <= number < root + node_count(size)
            assert depth <= np.log2(size) + 1
            node = by_number[number]
            for k, reference in enumerate(node[12:14].view(np.int32).tolist()):
                child_low, child_high = node[6 * k : 6 * k + 3], node[6 * k + 3 : 6 * k + 6]
                if reference == 0:
                    assert size == 1
                    assert np.isinf(child_low).all()
                    continue
                assert (child_low >= low).all()
                assert (child_high <= high).all()
                if reference > 0:
                    pending.append((reference, child_low, child_high, depth + 1))
                else:
                    row = (-1 - reference) // 4
                    found.append(row)
                    at = start + int(np.flatnonzero(rows[start : start + size] == row)[0])
                    np.testing.assert_array_equal(node[6 * k : 6 * k + 6], boxes[at])
        assert sorted(found) == sorted(rows[start : start + size].tolist())


@pytest.mark.parametrize("sizes", [[1], [2], [3], [402], [1, 5, 1, 64, 17]])
def test_every_instance_is_in_one_leaf_inside_all_boxes_above(sizes: list[int]) -> None:
    random = np.random.default_rng(len(sizes))
    total = sum(sizes)
    boxes = random.uniform(-5.0, 5.0, (total, 6)).astype(np.float32)
    boxes[:, 3:] = boxes[:, :3] + random.uniform(0.0, 2.0, (total, 3)).astype(np.float32)
    rows = random.permutation(total).astype(np.int32)
    starts, roots = np.cumsum([0, *sizes[:-1]]), 7 + 1000 * np.arange(len(sizes))
    nodes, numbers = median_trees(boxes, rows, starts, roots)
    check_trees(nodes, numbers, boxes, rows, sizes, roots.tolist())


@pytest.mark.parametrize("count", [1, 2, 3, 300])
def test_tree_keeps_its_topology_while_few_instances_move(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    random, built = np.random.default_rng(count), []
    monkeypatch.setattr(instance_tree, "median_trees", lambda *args: built.append(1) or median_trees(*args))
    boxes = random.uniform(-5.0, 5.0, (count, 6)).astype(np.float32)
    boxes[:, 3:] = boxes[:, :3] + random.uniform(0.0, 2.0, (count, 3)).astype(np.float32)
    rows, trees = 4 * random.permutation(count).astype(np.int32), InstanceTrees()
    for root, distance, expected in ((7, 0.0, 1), (900, 0.1, 1), (900, 0.3, 1), (7, 100.0, 2), (900, 100.1, 2)):
        moved = boxes.copy()
        moved[:1] += np.float32(distance)
        nodes, numbers = trees.build([(moved, rows)], [root])
        check_trees(nodes, numbers, moved, rows, [count], [root])
        if count == 300:  # of fewer, each is much of the whole area
            assert len(built) == expected


def test_area_of_boxes_may_be_more_than_a_number_holds() -> None:
    boxes = np.float32([[0, 0, 0, 1, 1, 1], [1, 1, 1, 2, 2, 2], [-1e30, -1e30, -1e30, 1e30, 1e30, 1e30]])
    rows, trees = np.arange(3, dtype=np.int32), InstanceTrees()
    for _ in range(3):
        nodes, numbers = trees.build([(boxes, rows)], [5])
        check_trees(nodes, numbers, boxes, rows, [3], [5])


def test_several_trees_at_once_are_those_that_are_built_one_by_one() -> None:
    random = np.random.default_rng(1)
    sizes, roots = [5, 1, 40, 2, 3, 9], [100 * k for k in range(1, 7)]
    trees = []
    for size in sizes:
        low = random.uniform(-5.0, 5.0, (size, 3)).astype(np.float32)
        trees.append((np.concatenate([low, low + 1.0], axis=1), random.permutation(size).astype(np.int32)))
    nodes, numbers = InstanceTrees().build(trees, roots)
    single = [InstanceTrees().build([tree], [root]) for tree, root in zip(trees, roots, strict=True)]
    order = np.argsort(numbers)
    assert nodes[order].tobytes() == b"".join(each.tobytes() for each, _ in single)
    np.testing.assert_array_equal(numbers[order], np.concatenate([each for _, each in single]))


def test_placing_instances_builds_nothing_in_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(2)
    scene = scene_of((BALL,), placed([0] * 50, random_matrices(random, 50, 4.0)), "bvh2")
    rays = random_rays(random, 2000, 6.0)
    expected = trace_rays(scene_of((BALL,), moved := placed([0] * 50, random_matrices(random, 50, 4.0))), rays)

    def grow(*_args: object) -> None:
        raise AssertionError("a tree is built by one thread")

    monkeypatch.setattr(Workspace, "grow", grow)
    writes = []
    write = layout_kernels.write_rows
    monkeypatch.setattr(bvh.layout_kernels, "write_rows", lambda *args: writes.append(len(args[0])) or write(*args))
    scene.place(moved, (0, 1, 2))
    found = trace_rays(scene, rays)
    assert (found.instance >= 0).sum() > 500
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(writes) <= 1


def test_refitting_by_level_equals_refitting_from_last_to_first() -> None:
    tree = Bvh("bvh2")
    blas = tree.add_mesh(BALL.positions, BALL.triangles, 0, deforms=True)
    moved = (BALL.positions * [1.0, 0.3, 2.0] + 0.1).astype(np.float32)
    tree.refit(blas, upload(moved), upload(BALL.triangles), 0)
    nodes, rows = tree.nodes.to_numpy(), tree.leaf_blocks.to_numpy()
    references = nodes[:, 12:14].view(np.int32)
    for number in reversed(blas.nodes):
        for k, reference in enumerate(references[number].tolist()):
            if reference > 0:
                below = nodes[reference, :12].reshape(2, 2, 3)
                low, high = below[:, 0].min(axis=0), below[:, 1].max(axis=0)
            else:
                first, more = divmod(-1 - reference, 4)
                corners = rows[first : first + more + 1].reshape(-1, 4)[:, :3]
                low, high = corners.min(axis=0), corners.max(axis=0)
                margin = np.float32(max(np.float32(4e-7) * np.abs([low, high]).max(), np.float32(1e-12)))
                low, high = low - margin, high + margin
            np.testing.assert_array_equal(nodes[number, 6 * k : 6 * k + 3], low)
            np.testing.assert_array_equal(nodes[number, 6 * k + 3 : 6 * k + 6], high)
    levels = levels_below(blas.nodes.start, references[blas.nodes.start : blas.nodes.stop])
    assert sorted(np.concatenate(levels).tolist()) == list(blas.nodes)


def test_no_other_kernel_has_a_serial_loop() -> None:
    found = set()
    for file in [*ROOT.glob("tiscene/**/*.py"), *ROOT.glob("dynamics/**/*.py")]:
        source = file.read_text(encoding="utf-8")
        if "serialize=True" in source:
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.FunctionDef) and "serialize=True" in ast.unparse(node):
                    found.add(node.name)
    assert found == SERIAL

# SPDX-License-Identifier: Apache-2.0
"""Trees hold every triangle once, inside all boxes above it, and are the same bytes at every build."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.scene.bvh import bvh, layout_kernels, tree_arrays
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.instance_tree import InstanceTrees
from tiscene.scene.bvh.workspace import Workspace

both_layouts = pytest.mark.parametrize("layout", ["bvh8", "bvh2"])
Child = tuple[NDArray[np.float32], int]


class Tree:
    """The arrays of a hierarchy, read back."""

    def __init__(self, tree: Bvh) -> None:
        self.is_bvh8 = tree.layout is bvh.BVH8
        self.nodes = tree.nodes.to_numpy()
        self.leaf_blocks = tree.leaf_blocks.to_numpy()

    def children(self, reference: int) -> list[Child]:
        """Box [6] and reference of each child of an inner node."""
        if self.is_bvh8:
            rows = self.nodes[reference : reference + 7]
            found = [(rows[:6, k], int(rows[6].view(np.int32)[k])) for k in range(8)]
        else:
            row = self.nodes[reference]
            found = [(row[6 * k : 6 * k + 6], int(row[12:14].view(np.int32)[k])) for k in range(2)]
        assert all(reference != 0 or box[0] >= 1e30 for box, reference in found)
        return [(box, reference) for box, reference in found if reference != 0]

    def triangles(self, reference: int) -> list[tuple[int, NDArray[np.float32]]]:
        """Number and corners [3, 3] of each triangle of a leaf."""
        if self.is_bvh8:
            block = self.leaf_blocks[-1 - reference : 9 - reference]
            parts = [(int(block[9].view(np.int32)[k]), block[:9, k].reshape(3, 3)) for k in range(4)]
            assert all((block[:9, k] == 0.0).all() for k in range(4) if parts[k][0] < 0)
            numbers = [number for number, _ in parts if number >= 0]
            assert numbers == sorted(numbers)
        else:
            first, last = divmod(-1 - reference, 4)
            rows = self.leaf_blocks[first : first + last + 1]
            parts = [(int(row[3:4].view(np.int32)[0]), row[[0, 1, 2, 4, 5, 6, 8, 9, 10]].reshape(3, 3)) for row in rows]
        return [(n, corners) for n, corners in parts if n >= 0]

    def walk(self, root: int) -> tuple[list[int], int, int]:
        """Check every box below a root; return the triangles, the number of nodes, and the stack that is needed."""
        found: list[int] = []
        nodes = max_stack = 0
        pending = [(root, np.array([[-np.inf] * 3, [np.inf] * 3]), 0)]
        while pending:
            reference, (low, high), stacked = pending.pop()
            if reference < 0:
                for number, corners in self.triangles(reference):
                    found.append(number)
                    assert (corners >= low).all()
                    assert (corners <= high).all()
                continue
            nodes += 1
            children = self.children(reference)
            stacked += max(len(children) - 1, 0)
            max_stack = max(max_stack, stacked)
            for box, child in children:
                assert child < 0 or child > reference  # depth first
                assert (box[:3] >= low).all()
                assert (box[3:] <= high).all()
                pending.append((child, box.reshape(2, 3), stacked))
        return found, nodes, max_stack


def random_triangles(count: int, seed: int = 0) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    random = np.random.default_rng(seed)
    corners = random.uniform(-5, 5, (count, 1, 3)) + random.normal(0.0, 0.2, (count, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def nested_triangles(count: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return triangles of decreasing size, which SAH splits off one at a time: a deep tree."""
    size = 10.0 ** -np.linspace(0.0, 30.0, count)
    corners = np.array([[1, 1, 1], [2, 1, 1.5], [1, 2, 2]]) * size[:, None, None]
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@both_layouts
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9, 64, 65, 1000, 20_000])
def test_every_triangle_is_in_exactly_one_leaf(layout: str, count: int) -> None:
    tree = Bvh(layout)
    tree.add_mesh(*random_triangles(3), 0)
    blas = tree.add_mesh(*random_triangles(count), 100)
    found, nodes, max_stack = Tree(tree).walk(blas.root)
    assert sorted(found) == list(range(100, 100 + count))
    assert nodes <= max(1, count - 1)
    assert max_stack <= tree.layout.blas_stack
    positions = random_triangles(count)[0]
    np.testing.assert_allclose(blas.box, [positions.min(axis=0), positions.max(axis=0)], atol=1e-5)
    assert (blas.box[0] < positions.min(axis=0)).all()
    assert (blas.box[1] > positions.max(axis=0)).all()


@both_layouts
def test_adding_meshes_keeps_existing_trees(layout: str) -> None:
    tree = Bvh(layout)
    first = tree.add_mesh(*random_triangles(50), 0)
    before = Tree(tree).walk(first.root)
    for k in range(6):
        tree.add_mesh(*random_triangles(10 * 3**k, seed=k), 1000)
    assert Tree(tree).walk(first.root) == before


@both_layouts
@pytest.mark.parametrize("count", [7, 100, 5000])
def test_triangles_with_equal_centers_are_halved(layout: str, count: int) -> None:
    positions = np.tile(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), (count, 1))
    tree = Bvh(layout)
    blas = tree.add_mesh(positions, np.arange(3 * count, dtype=np.int32).reshape(-1, 3), 0)
    found, _, max_stack = Tree(tree).walk(blas.root)
    assert sorted(found) == list(range(count))
    assert max_stack <= tree.layout.blas_stack


def test_more_nodes_than_references_can_hold_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout_kernels, "MAX_NODES", 100)
    with pytest.raises(ArgumentError, match="nodes of trees are more than the bvh8 traversal supports"):
        Bvh("bvh8").add_mesh(*random_triangles(3000), 0)


@both_layouts
def test_tree_too_deep_for_the_stack_is_balanced(layout: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def limit_stack(entries: int) -> None:
        limited = replace(bvh.LAYOUTS[layout], blas_stack=entries)
        monkeypatch.setitem(bvh.LAYOUTS, layout, limited)
        if layout == "bvh8":
            for module in (bvh, tree_arrays):
                monkeypatch.setattr(module, "BVH8", limited)

    def build() -> tuple[list[int], int, int]:
        tree = Bvh(layout)
        root = tree.add_mesh(*nested_triangles(300), 0).root
        return Tree(tree).walk(root)

    deep = build()[2]
    assert deep > 12
    limit_stack(deep - 1)
    found, _, balanced = build()
    assert sorted(found) == list(range(300))
    assert balanced < deep
    limit_stack(3)
    with pytest.raises(ArgumentError, match="300 triangles in one mesh"):
        build()


@both_layouts
def test_mesh_of_degenerate_triangles_is_empty(layout: str) -> None:
    tree = Bvh(layout)
    line = np.array([[0, 0, 0], [1, 1, 1], [3, 3, 3], [0, 1, 0]], np.float32)
    for triangles in (np.zeros((0, 3), np.int32), np.array([[0, 1, 0], [1, 1, 3]], np.int32)):
        blas = tree.add_mesh(line, triangles, 0)
        assert blas.empty
        assert Tree(tree).walk(blas.root) == ([], 1, 0)
    blas = tree.add_mesh(line, np.array([[0, 1, 2], [0, 1, 3]], np.int32), 10)
    assert not blas.empty
    assert sorted(Tree(tree).walk(blas.root)[0]) == [10, 11]


def tlas_instances(tree: Bvh, time: int) -> list[int]:
    """The instances at a time, in the order of the tree."""
    arrays, found, pending = Tree(tree), [], [tree.root(time)]
    while pending:
        for _, reference in arrays.children(pending.pop()):
            if reference >= 0:
                pending.append(reference)
            else:
                found.append(-1 - reference if arrays.is_bvh8 else (-1 - reference) // 4)
    return found


@both_layouts
def test_each_time_has_its_own_tree(layout: str) -> None:
    tree = Bvh(layout)
    blas = tree.add_mesh(*random_triangles(100), 0)
    random = np.random.default_rng(3)
    for count in (1, 3, 64, 65, 1000):  # the regions move when they must grow
        low = random.uniform(-50.0, 50.0, (count, 3))
        boxes = np.concatenate([low, low + 1.0], axis=1)
        tree.clear_instances()
        for time, rows in enumerate((np.arange(count), np.arange(count)[::2], np.arange(0))):
            tree.place(time, boxes[rows], rows.astype(np.int32), count)
        assert sorted(tlas_instances(tree, 0)) == list(range(count))
        assert sorted(tlas_instances(tree, 1)) == list(range(0, count, 2))
        assert tlas_instances(tree, 2) == []
        assert sorted(Tree(tree).walk(blas.root)[0]) == list(range(100))
    tree.clear_instances()
    with pytest.raises(ArgumentError, match="no instances are placed"):
        tree.root(1)


@both_layouts
def test_recently_placed_tree_is_not_built_again(layout: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = Bvh(layout)
    built: list[int] = []
    grow = Workspace.grow
    monkeypatch.setattr(Workspace, "grow", lambda self, *args: built.append(len(args[0])) or grow(self, *args))
    build = InstanceTrees.build

    def counted(self: InstanceTrees, trees: list[Child], roots: list[int]) -> object:
        built.extend(len(rows) for _, rows in trees)
        return build(self, trees, roots)

    monkeypatch.setattr(InstanceTrees, "build", counted)
    rows = np.arange(40, dtype=np.int32)
    boxes = np.random.default_rng(3).uniform(0, 9, (7, 40, 6))
    boxes[..., 3:] += boxes[..., :3]
    for frame in range(1, 6):
        tree.clear_instances()
        for time in (0, 1, 2):
            tree.place(time, boxes[frame + time - 1], rows, capacity=40)
        tree.place(3, boxes[frame, :5], rows[:5], capacity=40)
        tree.place(3, boxes[frame, :4], rows[:4], capacity=40)
        lows = [boxes[frame + time - 1, :, :3].min(axis=0) for time in (0, 1, 2)] + [boxes[frame, :4, :3].min(axis=0)]
        for time, low in enumerate(lows):
            assert sorted(tlas_instances(tree, time)) == list(range(40 if time < 3 else 4))
            corners = [box[:3] for box, _ in Tree(tree).children(tree.root(time))]
            np.testing.assert_allclose(np.min(corners, axis=0), low, atol=1e-4)
    if layout == "bvh8":
        assert built == [40, 40, 40, 5, 4] + [40, 5, 4] * 4
    else:  # built when it is read
        assert built == [40, 40, 40, 4] + [40, 4] * 4


def test_unknown_layout_is_refused() -> None:
    with pytest.raises(ArgumentError, match="'octal': must be one of bvh8, bvh2"):
        Bvh("octal")


def built_arrays(layout: str) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Two meshes, one of which is built in parallel."""
    tree = Bvh(layout)
    for mesh in (trimesh.creation.icosphere(subdivisions=2), trimesh.creation.icosphere(subdivisions=5)):
        tree.add_mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32), 0)
    nodes, leaf_blocks = tree.used_rows
    return tree.nodes.to_numpy()[:nodes], tree.leaf_blocks.to_numpy()[:leaf_blocks]


@both_layouts
def test_trees_are_the_same_bytes_with_one_thread(layout: str, tmp_path: Path) -> None:
    here = built_arrays(layout)
    for first, second in zip(here, built_arrays(layout), strict=True):
        np.testing.assert_array_equal(first.view(np.int32), second.view(np.int32))
    script = (
        "import sys, numpy\n"
        "from tiscene.device import runtime\n"
        "runtime.start(threads=1)\n"
        "from tests.scene.bvh.test_bvh import built_arrays\n"
        "numpy.savez(sys.argv[1], *built_arrays(sys.argv[2]))\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "tree.npz"), layout]
    subprocess.run(command, cwd=Path(__file__).parents[3], check=True, timeout=300)
    with np.load(tmp_path / "tree.npz") as other:
        for k, array in enumerate(here):
            np.testing.assert_array_equal(array.view(np.int32), other[f"arr_{k}"].view(np.int32))


@pytest.mark.parametrize("layout", ["bvh8", "bvh2"])
def test_meshes_built_together_equal_meshes_built_alone(layout):
    """Small, empty, degenerate and large meshes."""
    random = np.random.default_rng(8)
    sizes = (12, 0, 1, 300, 5, 4, 9000, 2, 70_000, 17)
    meshes = [random.normal(size=(3 * size, 3)).astype(np.float32) for size in sizes]
    meshes[5][:] = meshes[5][:1]  # all triangles of it are one point
    triangles = [np.arange(3 * size, dtype=np.int32).reshape(-1, 3) for size in sizes]
    together, alone = Bvh(layout), Bvh(layout)
    found = together.add_meshes(meshes, triangles, 100)
    first = 100
    for mesh, faces, blas in zip(meshes, triangles, found, strict=True):
        expected = alone.add_mesh(mesh, faces, first)
        assert blas.root == expected.root
        assert blas.entry == expected.entry
        np.testing.assert_array_equal(blas.box, expected.box)
        assert (blas.nodes, blas.leaf_blocks) == (expected.nodes, expected.leaf_blocks)
        first += len(faces)
    for mine, theirs in ((together.nodes, alone.nodes), (together.leaf_blocks, alone.leaf_blocks)):
        mine, theirs = mine.to_numpy().view(np.int32), theirs.to_numpy().view(np.int32)
        count = min(len(mine), len(theirs))
        np.testing.assert_array_equal(mine[:count], theirs[:count])

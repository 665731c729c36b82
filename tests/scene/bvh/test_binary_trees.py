# SPDX-License-Identifier: Apache-2.0
"""Ranges that all threads split together become the tree that one thread builds."""

import numpy as np
import pytest
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, upload
from tiscene.errors import DeviceError
from tiscene.scene.bvh import binary_trees, build_kernels
from tiscene.scene.bvh.workspace import widened

COUNTS = 3000, 700, 1, 40  # primitives of each tree


def random_boxes(count: int) -> NDArray[np.float32]:
    random = np.random.default_rng(5)
    low = random.normal(0.0, 2.0, (count, 3)) ** 3
    boxes = np.concatenate([low, low + random.uniform(0.0, 0.3, (count, 3))], axis=1)
    boxes[1000:1600] = boxes[1000]  # cannot be told apart by any plane
    return widened(boxes)


def built(boxes: NDArray[np.float32], sah_depth: int, large: int, monkeypatch: pytest.MonkeyPatch):
    """Return boxes and links of the binary nodes, and the primitives in the order of the leaves."""
    monkeypatch.setattr(binary_trees, "LARGE", large)
    count, starts = sum(COUNTS), np.cumsum([0, *COUNTS[:-1]])
    tasks = np.stack([2 * starts, starts, starts + COUNTS, 0 * starts], axis=1).astype(np.int32)
    node_box, node_link = device_array(ti.f32, (2 * count, 6)), device_array(ti.i32, (2 * count, 4))
    primitives, rest = binary_trees.split_large(
        boxes, np.arange(count, dtype=np.int32), tasks, node_box, node_link, sah_depth, 1
    )
    assert (rest[:, 2] - rest[:, 1]).max() <= large
    assert (rest[:, 2] - rest[:, 1]).sum() == count
    build_kernels.grow(*primitives, node_box, node_link, upload(rest), 0, len(rest), 0, sah_depth, 4, 1, 1.0)
    return node_box.to_numpy(), node_link.to_numpy(), primitives.order.to_numpy()


@pytest.mark.parametrize("sah_depth", [40, 3, 0])
def test_tree_is_that_of_one_thread(sah_depth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    boxes = random_boxes(sum(COUNTS))
    box, link, _order = built(boxes, sah_depth, 10**6, monkeypatch)
    together_box, together_link, together_order = built(boxes, sah_depth, 64, monkeypatch)
    assert sorted(together_order.tolist()) == list(range(sum(COUNTS)))
    if sah_depth == 40:
        np.testing.assert_array_equal(together_box, box)
        np.testing.assert_array_equal(together_link, link)
    leaves = np.flatnonzero((together_link[:, 0] < 0) & (together_link[:, 3] > 0))
    for _, _, first, size in together_link[leaves].tolist():
        here = boxes[together_order[first : first + size]]
        slot = leaves[together_link[leaves, 2] == first][0]
        np.testing.assert_array_equal(together_box[slot], [*here[:, :3].min(axis=0), *here[:, 3:].max(axis=0)])
    same = built(boxes, sah_depth, 64, monkeypatch)
    for one, other in zip(same, (together_box, together_link, together_order), strict=True):
        np.testing.assert_array_equal(one, other)


def test_nodes_are_numbered_tree_after_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    box, link, _ = built(random_boxes(sum(COUNTS)), 40, 64, monkeypatch)
    starts = np.cumsum([0, *COUNTS[:-1]])
    nodes, found = binary_trees.numbered_nodes(box, link, (2 * starts).astype(np.int32))
    references = nodes[:, 12:14].view(np.int32)
    assert found[-1, 0] == len(nodes)
    assert found[:, 1].tolist() == np.cumsum(COUNTS).tolist()
    first, deepest = 0, 0
    for tree, (end, start, count) in enumerate(zip(found[:, 0].tolist(), starts.tolist(), COUNTS, strict=True)):
        rows, pending, visited = [], [(first, 1)], 0
        while pending:
            node, depth = pending.pop()
            visited += 1
            for reference in references[node].tolist():
                if reference > 0:
                    deepest = max(deepest, depth + 1)
                    assert node < reference < end
                    pending.append((reference, depth + 1))
                elif reference < 0:
                    row, more = divmod(-1 - reference, 4)
                    rows += range(row, row + more + 1)
        assert visited == end - first, tree
        assert sorted(rows) == list(range(start, start + count))
        first = end
    assert found[0, 2] == deepest
    placed = binary_trees.placed_nodes(nodes, 100, 1000)[:, 12:14].view(np.int32)
    assert (placed[references > 0] == references[references > 0] + 100).all()
    assert (placed[references < 0] == references[references < 0] - 4000).all()
    assert (placed[references == 0] == 0).all()


def test_links_that_form_a_cycle_are_reported() -> None:
    with pytest.raises(DeviceError, match="nodes form a cycle"):
        binary_trees.numbered_nodes(np.zeros((6, 6), np.float32), np.zeros((6, 4), np.int32), np.zeros(1, np.int32))

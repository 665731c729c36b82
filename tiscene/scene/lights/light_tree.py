# SPDX-License-Identifier: Apache-2.0
"""The light tree: an 8-wide hierarchy by which lights are sampled in proportion to their estimated contribution.

Implements Conty Estevez and Kulla, "Importance Sampling of Many Lights", 2018, with eight children a node, whose
importances a SIMD kernel computes at once. Node 0 is a header. The next nodes hold the *entries*, which are weighed at
every shading point: finite lights, portals, distant lights, domes. A long list of one of these sorts becomes eight
entries; each is a group whose children are in a node of their own, and sampling descends from the chosen entry.

A *slot* names a child: LANES * node + lane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LANE_BITS = 3
LANES = 1 << LANE_BITS
# Attributes of a node's children: attribute a of child k is in column LANES * a + k of the node.
#
# CENTER (3), NORMAL (3), ROUND, STRENGTH, SIZE2, SPREAD2, BACK: the importance. At distance d and height h above the
#     plane of a child (against NORMAL, the direction in which a flat light emits), its estimated irradiance (luminance,
#     W/m²) is STRENGTH * (ROUND * d + max(h, -BACK * h)) / (d * max(d² + SIZE2, SPREAD2)). Portals beside a point are
#     weighed by their solid angle instead.
# SPREAD2: mean squared distance of a group's lights from its center, m²; 0 for a light.
# BACK: weight of the back side; CONE for a light with a cone, whose falloff is applied besides.
# UNIFORM: part of an entry's probability that is the same at every shading point.
# ROW: row of the light in the light table; of a triangle its number in the mesh; -1 for a group or an empty lane.
# CHILD: node of a group's children; 0 for a light.
# EXTENT: sqrt(SIZE2 + SPREAD2), about the child's radius, m.
# Of a dome, ROUND is 1 if it has no portals, and SIZE2 is the odds of sampling its image rather than its portals.
CENTER, NORMAL, ROUND, STRENGTH, SIZE2, SPREAD2, BACK, UNIFORM, ROW, CHILD, EXTENT = 0, 3, *range(6, 15)
ATTRIBUTES = 15
CONE = -1.0

# Attributes of the node itself. PARENT: slot of the group whose children these are; 0 for entries and for the root of a
# mesh's triangles. COUNT: number of children. CONES, GROUPS: whether any child has a cone, is a group.
PARENT, COUNT, CONES, GROUPS = range(LANES * ATTRIBUTES, LANES * ATTRIBUTES + 4)
NODE_COLUMNS = 128
ROWS = NODE_COLUMNS // LANES  # of a node in the device table, whose rows have LANES numbers

# Columns of the header. H_..._END: index after the last entry of a sort. H_HAS_CHOICE: whether there is more than one
# light. H_ENTRY_NODES: nodes that hold entries. H_NON_DOME_NODES: how many of them hold other entries than domes.
# H_AREA_COUNT: lights that rays can hit. H_BVH_ROW: row of the device table where their BVH begins (see `light_bvh`).
# H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW: first row of each sort in the light table. H_ROWS, H_END: number of rows
# without and with emissive meshes.
H_FINITE_END, H_PORTAL_END, H_DISTANT_END, H_DOME_END, H_HAS_CHOICE, H_ENTRY_NODES, H_NON_DOME_NODES = range(7)
H_AREA_COUNT, H_BVH_ROW, H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW, H_ROWS, H_END = range(7, 14)

# Up to these numbers, finite lights and lights of each other sort are entries themselves; more become LANES groups.
MAX_FINITE_ENTRIES = 16
MAX_OTHER_ENTRIES = LANES
MAX_ENTRIES = MAX_FINITE_ENTRIES + 3 * MAX_OTHER_ENTRIES
# Fraction of the samples that is spread evenly over the entries, for contributions that the estimates miss.
UNIFORM_FRACTION = 0.1
# Squared distance, m², of lights at infinity.
FAR2 = 1e16
# A group is never as flat as its lights: a point behind its plane may be in front of some of them.
_MAX_FLATNESS = 0.8

Floats = NDArray[np.float32]


def empty_rows(count: int) -> Floats:
    """Return the attributes [count, ATTRIBUTES] of empty lanes."""
    result = np.zeros((count, ATTRIBUTES), np.float32)
    result[:, ROW] = -1.0
    return result


def child_rows(node: Floats) -> Floats:
    """Return the attributes [COUNT, ATTRIBUTES] of a node's children."""
    return np.asarray(node[: LANES * ATTRIBUTES].reshape(ATTRIBUTES, LANES).T[: int(node[COUNT])])


def light_slots(nodes: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (rows, slots) of all lights below some nodes; slots count from the first of these nodes."""
    rows = nodes[:, LANES * ROW : LANES * (ROW + 1)].ravel()
    found = np.flatnonzero(rows >= 0.0)
    return rows[found].astype(np.int64), found


def build_tree(leaves: Floats) -> Floats:
    """Build a tree over lights.

    A node's children are found by three splits at the median along the longest side of their centers' box.

    Args:
        leaves: float32 [n, ATTRIBUTES], n > 0, the lights.

    Returns:
        float32 [m, NODE_COLUMNS], level by level; CHILD and PARENT count from the first node.
    """
    levels = []
    order, starts, parents = np.arange(len(leaves)), np.array([0]), np.array([0])
    used = 0
    while len(parents):
        first, count = used, len(parents)
        of = np.arange(count)  # the node that each group is a child of
        for _ in range(LANE_BITS):
            order, starts, split = split_groups(order, starts, leaves[:, CENTER : CENTER + 3])
            of = np.repeat(of, split)
        used += count
        sizes = np.diff(starts, append=len(order))
        rows = leaves[order[starts]].copy()
        many = sizes > 1
        lane = np.arange(len(of)) - np.searchsorted(of, of)
        within = np.repeat(many, sizes)
        order, sizes = order[within], sizes[many]
        starts = np.cumsum(sizes) - sizes
        if len(order):
            rows[many] = _groups(leaves[order].astype(np.float64), starts, np.repeat(np.arange(len(sizes)), sizes))
        rows[many, CHILD] = used + np.arange(len(sizes))
        levels.append(_nodes(rows, of, lane, parents))
        parents = LANES * (first + of[many]) + lane[many]
    return np.concatenate(levels)


def split_groups(
    order: NDArray[np.int64], starts: NDArray[np.int64], positions: Floats
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Split groups of leaves at the median along their longest side.

    Args:
        order: int64 [n], leaves, group after group.
        starts: int64 [g], where each group begins in `order`.
        positions: float [leaves, 3], centers.

    Returns:
        (order, starts, how many groups each has become, 1 or 2).
    """
    counts = np.diff(starts, append=len(order))
    of = np.repeat(np.arange(len(starts)), counts)
    here = positions[order]
    extents = np.maximum.reduceat(here, starts) - np.minimum.reduceat(here, starts)
    order = order[np.lexsort((here[np.arange(len(order)), extents.argmax(axis=1)[of]], of))]
    both = np.stack([starts, starts + (counts + 1) // 2], axis=1)
    real = np.stack([counts > 0, counts > 1], axis=1)
    return order, both[real], real.sum(axis=1)


def _nodes(rows: Floats, of: NDArray[np.int64], lane: NDArray[np.int64], parents: NDArray[np.int64]) -> Floats:
    """Return nodes [len(parents), NODE_COLUMNS].

    Args:
        rows: float32 [n, ATTRIBUTES], their children.
        of: int64 [n], node of each child.
        lane: int64 [n], lane of each child.
        parents: int64 [m], PARENT of each node.
    """
    table = np.tile(empty_rows(1), (len(parents), LANES, 1))
    table[of, lane] = rows
    table[:, :, EXTENT] = np.sqrt(table[:, :, SIZE2] + table[:, :, SPREAD2])
    result = np.zeros((len(parents), NODE_COLUMNS), np.float32)
    result[:, : LANES * ATTRIBUTES] = table.transpose(0, 2, 1).reshape(len(parents), LANES * ATTRIBUTES)
    result[:, PARENT] = parents
    result[:, COUNT] = np.bincount(of, minlength=len(parents))
    result[:, CONES] = (table[:, :, BACK] < 0.0).any(axis=1)
    result[:, GROUPS] = (table[:, :, CHILD] > 0.0).any(axis=1)
    return result


def rebased(nodes: Floats, offset: int) -> Floats:
    """Return a tree for a table in which `offset` nodes precede it."""
    result = nodes.copy()
    child = result[:, LANES * CHILD : LANES * (CHILD + 1)]
    child += np.where(child > 0.0, offset, 0)
    result[1:, PARENT] += LANES * offset
    return result


def group_row(leaves: Floats) -> Floats:
    """Return the attributes [ATTRIBUTES] of a group of all these lights."""
    row: Floats = _groups(leaves.astype(np.float64), np.array([0]), np.zeros(len(leaves), np.int64))[0]
    return row


def _groups(leaves: NDArray[np.float64], starts: NDArray[np.int64], of: NDArray[np.int64]) -> Floats:
    """Return the attributes of groups of consecutive leaves; starts: first leaf of each; of: each leaf's group."""
    result = empty_rows(len(starts)).astype(np.float64)
    strength = np.add.reduceat(leaves[:, STRENGTH], starts)
    weight = np.where(strength[of] > 0.0, leaves[:, STRENGTH], 1.0)
    weight = (weight / np.add.reduceat(weight, starts)[of])[:, None]
    center = np.add.reduceat(weight * leaves[:, CENTER : CENTER + 3], starts)
    offset2 = ((leaves[:, CENTER : CENTER + 3] - center[of]) ** 2).sum(axis=1)
    normals = leaves[:, NORMAL : NORMAL + 3]
    both_sides = leaves[:, BACK] > 0.5
    opposite = both_sides & ((normals * normals[starts][of]).sum(axis=1) < 0.0)
    normals = np.where(opposite[:, None], -normals, normals)
    result[:, CENTER : CENTER + 3] = center
    result[:, NORMAL : NORMAL + 3] = _MAX_FLATNESS * np.add.reduceat(weight * normals, starts)
    result[:, ROUND] = 1.0 - np.linalg.norm(result[:, NORMAL : NORMAL + 3], axis=1)
    result[:, STRENGTH] = strength
    result[:, SIZE2] = np.add.reduceat(weight[:, 0] * leaves[:, SIZE2], starts)
    result[:, SPREAD2] = np.add.reduceat(weight[:, 0] * offset2, starts)
    result[:, BACK] = np.maximum.reduceat(np.maximum(leaves[:, BACK], 0.0), starts)
    return result.astype(np.float32)


def assemble(finite: Floats, portals: Floats, distants: Floats, domes: Floats) -> Floats:
    """Return the header and all nodes, from the attributes of the lights of each sort. The header's rows are left 0."""
    header = np.zeros(NODE_COLUMNS, np.float32)
    sorts = (
        (finite, MAX_FINITE_ENTRIES),
        (portals, MAX_OTHER_ENTRIES),
        (distants, MAX_OTHER_ENTRIES),
        (domes, MAX_OTHER_ENTRIES),
    )
    trees = [build_tree(leaves) if len(leaves) > limit else None for leaves, limit in sorts]
    entries = [
        leaves if nodes is None else child_rows(nodes[0]) for (leaves, _), nodes in zip(sorts, trees, strict=True)
    ]
    ends = np.cumsum([len(rows) for rows in entries])
    count = int(ends[-1])
    used = at = 1 + -(-count // LANES)  # nodes
    rows = np.concatenate(entries)
    further = []
    for nodes, end, leaves in zip(trees, ends, entries, strict=True):
        if nodes is not None:
            first = int(end) - len(leaves)
            # The root is dropped: its children become entries, and their children get other parents.
            offset, top = at - 1, nodes[:, PARENT] < LANES
            lanes = nodes[1:, PARENT][top[1:]]
            nodes = rebased(nodes, offset)
            nodes[1:, PARENT][top[1:]] = LANES + first + lanes
            rows[first:end, CHILD] = child_rows(nodes[0])[:, CHILD]
            further.append(nodes[1:])
            at += len(nodes) - 1
    is_dome = np.arange(count) >= ends[2]
    uniform = (rows[:, STRENGTH] > 0.0) & (~is_dome | (rows[:, ROUND] > 0.0))
    rows[:, UNIFORM] = uniform * (UNIFORM_FRACTION / max(int(uniform.sum()), 1))
    slots = np.arange(count)
    nodes = _nodes(rows, slots // LANES, slots % LANES, np.zeros(used - 1, np.int64))
    header[[H_FINITE_END, H_PORTAL_END, H_DISTANT_END, H_DOME_END]] = ends
    header[H_HAS_CHOICE] = count > 1 or len(further) > 0
    header[H_ENTRY_NODES] = used - 1
    header[H_NON_DOME_NODES] = -(-int(ends[2]) // LANES)
    return np.concatenate([header[None], nodes, *further])

# SPDX-License-Identifier: Apache-2.0
"""What lights are chosen by: nodes of up to eight members, each a light or a group of lights, with about what it gives
where.

Row 0 is a header. Then come the nodes of *entries*, which every choice looks at: lights that have a place, portals,
distant lights, domes. Many lights of a sort are eight entries, each a group, whose members are a node of their own: a
choice goes on into one of them (Conty Estevez and Kulla, "Importance Sampling of Many Lights", 2018; by eight, since
what eight members give is computed at once).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LANE_BITS = 3
LANES = 1 << LANE_BITS
# What a node knows of its members: attribute a of member k stands in column LANES * a + k.
# NORMAL: against which a flat light shines. To a point at distance d and at height h against the normal a member
# gives STRENGTH * (ROUND * d + max(h, -BACK * h)) / (d * max(d * d + SIZE2, SPREAD2)), about the irradiance by
# luminance, W/m²; where BACK is CONE, its light has a cone besides. SPREAD2: how far a group's members are from its
# center, squared, in the mean; 0 of a light. EVEN: the least chance of an entry. ROW: the light's, or -1 for a group or
# no member. CHILD: the node of a group's members, else 0. EXTENT: the root of SIZE2 + SPREAD2, about how far a member
# reaches.
# Of a dome ROUND is 1 where it has no portals; SIZE2: its part of samples by its image, over that by its portals.
CENTRE, NORMAL, ROUND, STRENGTH, SIZE2, SPREAD2, BACK, EVEN, ROW, CHILD, EXTENT = 0, 3, *range(6, 15)
ATTRIBUTES = 15
CONE = -1.0

# After these columns: the place of the group whose members these are (node * LANES + lane; 0 for entries, and for the
# first node of a mesh's triangles); how many there are; whether there are cones and groups among them.
PARENT, COUNT, CONES, GROUPS = range(LANES * ATTRIBUTES, LANES * ATTRIBUTES + 4)
NODE_COLUMNS = 128
ROWS = NODE_COLUMNS // LANES  # of a node in a table of rows of LANES numbers

# Columns of the header: where the entries of a sort end, counted from 0; whether there is anything to choose; how many
# nodes hold the entries, and how many of them, from the first, any but domes; how many lights a ray can meet, and at
# which row of the table their `light_boxes` begin; the rows where distant lights, domes and portals begin, and where
# they end; where those of meshes end.
H_LAMPS, H_PORTALS, H_DISTANTS, H_DOMES, H_CHOICE, H_NODES, H_PLACED_NODES, H_SOLID_COUNT, H_BOXES = range(9)
H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW, H_ROWS, H_END = range(9, 14)

# So many lamps are entries one by one, more are LANES groups; so many of each other sort.
FEW = 16
FEW_OTHERS = LANES
MOST_ENTRIES = FEW + 3 * FEW_OTHERS
# This part of the choices is even, for what the estimates do not know of.
EVEN_PART = 0.1
# Whoever is so far away, squared, is as far away from everywhere.
FAR2 = 1e16
# A group is never as flat as its members: one that faces a point may be in it where the others do not.
_FLATTEST = 0.8

Floats = NDArray[np.float32]


def no_members(count: int) -> Floats:
    """Rows of attributes, [count, ATTRIBUTES], of nothing."""
    result = np.zeros((count, ATTRIBUTES), np.float32)
    result[:, ROW] = -1.0
    return result


def members(node: Floats) -> Floats:
    """The rows of a node's members."""
    return np.asarray(node[: LANES * ATTRIBUTES].reshape(ATTRIBUTES, LANES).T[: int(node[COUNT])])


def places(nodes: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows of all lights in some nodes, and their places, counted from the first of these."""
    rows = nodes[:, LANES * ROW : LANES * (ROW + 1)].ravel()
    found = np.flatnonzero(rows >= 0.0)
    return rows[found].astype(np.int64), found


def tree(leaves: Floats) -> Floats:
    """The nodes of a tree over leaves [n, ATTRIBUTES], n > 0, level by level: f32 [m, NODE_COLUMNS].

    Groups are halved along their longest side, three times for a node. CHILD and PARENT count from the first node.
    """
    levels = []
    order, starts, parents = np.arange(len(leaves)), np.array([0]), np.array([0])
    used = 0
    while len(parents):
        first, count = used, len(parents)
        of = np.arange(count)  # the node that each group is a member of
        for _ in range(LANE_BITS):
            order, starts, split = halved(order, starts, leaves[:, CENTRE : CENTRE + 3])
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


def halved(
    order: NDArray[np.int64], starts: NDArray[np.int64], positions: Floats
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Groups of leaves cut in two along their longest side: (order, starts, how many each has become, 1 or 2)."""
    counts = np.diff(starts, append=len(order))
    of = np.repeat(np.arange(len(starts)), counts)
    here = positions[order]
    extents = np.maximum.reduceat(here, starts) - np.minimum.reduceat(here, starts)
    order = order[np.lexsort((here[np.arange(len(order)), extents.argmax(axis=1)[of]], of))]
    both = np.stack([starts, starts + (counts + 1) // 2], axis=1)
    real = np.stack([counts > 0, counts > 1], axis=1)
    return order, both[real], real.sum(axis=1)


def _nodes(rows: Floats, of: NDArray[np.int64], lane: NDArray[np.int64], parents: NDArray[np.int64]) -> Floats:
    """Nodes from the rows of their members. of, lane: of each row; parents: of each node."""
    table = np.tile(no_members(1), (len(parents), LANES, 1))
    table[of, lane] = rows
    table[:, :, EXTENT] = np.sqrt(table[:, :, SIZE2] + table[:, :, SPREAD2])
    result = np.zeros((len(parents), NODE_COLUMNS), np.float32)
    result[:, : LANES * ATTRIBUTES] = table.transpose(0, 2, 1).reshape(len(parents), LANES * ATTRIBUTES)
    result[:, PARENT] = parents
    result[:, COUNT] = np.bincount(of, minlength=len(parents))
    result[:, CONES] = (table[:, :, BACK] < 0.0).any(axis=1)
    result[:, GROUPS] = (table[:, :, CHILD] > 0.0).any(axis=1)
    return result


def moved(nodes: Floats, offset: int, first_row: int = 0) -> Floats:
    """A whole tree so many nodes further on, of leaves whose rows begin at first_row."""
    result = nodes.copy()
    child, row = (result[:, LANES * column : LANES * (column + 1)] for column in (CHILD, ROW))
    child += np.where(child > 0.0, offset, 0)
    row += np.where(row >= 0.0, first_row, 0)
    result[1:, PARENT] += LANES * offset
    return result


def group(leaves: Floats) -> Floats:
    """The row of a group that holds all of them."""
    row: Floats = _groups(leaves.astype(np.float64), np.array([0]), np.zeros(len(leaves), np.int64))[0]
    return row


def _groups(leaves: NDArray[np.float64], starts: NDArray[np.int64], of: NDArray[np.int64]) -> Floats:
    """Rows for groups of leaves that stand together. starts: of each group; of: of each leaf its group."""
    result = no_members(len(starts)).astype(np.float64)
    strength = np.add.reduceat(leaves[:, STRENGTH], starts)
    weight = np.where(strength[of] > 0.0, leaves[:, STRENGTH], 1.0)
    weight = (weight / np.add.reduceat(weight, starts)[of])[:, None]
    center = np.add.reduceat(weight * leaves[:, CENTRE : CENTRE + 3], starts)
    offset2 = ((leaves[:, CENTRE : CENTRE + 3] - center[of]) ** 2).sum(axis=1)
    normals = leaves[:, NORMAL : NORMAL + 3]
    both_sides = leaves[:, BACK] > 0.5
    opposite = both_sides & ((normals * normals[starts][of]).sum(axis=1) < 0.0)
    normals = np.where(opposite[:, None], -normals, normals)
    result[:, CENTRE : CENTRE + 3] = center
    result[:, NORMAL : NORMAL + 3] = _FLATTEST * np.add.reduceat(weight * normals, starts)
    result[:, ROUND] = 1.0 - np.linalg.norm(result[:, NORMAL : NORMAL + 3], axis=1)
    result[:, STRENGTH] = strength
    result[:, SIZE2] = np.add.reduceat(weight[:, 0] * leaves[:, SIZE2], starts)
    result[:, SPREAD2] = np.add.reduceat(weight[:, 0] * offset2, starts)
    result[:, BACK] = np.maximum.reduceat(np.maximum(leaves[:, BACK], 0.0), starts)
    return result.astype(np.float32)


def assembled(lamps: Floats, portals: Floats, distants: Floats, domes: Floats) -> Floats:
    """All nodes, from the rows of the lights of each sort. The header's counts of rows are still zero."""
    header = np.zeros(NODE_COLUMNS, np.float32)
    sorts = (lamps, FEW), (portals, FEW_OTHERS), (distants, FEW_OTHERS), (domes, FEW_OTHERS)
    trees = [tree(leaves) if len(leaves) > few else None for leaves, few in sorts]
    entries = [leaves if nodes is None else members(nodes[0]) for (leaves, _), nodes in zip(sorts, trees, strict=True)]
    ends = np.cumsum([len(rows) for rows in entries])
    count = int(ends[-1])
    used = at = 1 + -(-count // LANES)  # nodes
    rows = np.concatenate(entries)
    further = []
    for nodes, end, leaves in zip(trees, ends, entries, strict=True):
        if nodes is not None:
            first = int(end) - len(leaves)
            # The tree's first node is gone: its members are entries, and those of theirs have other parents.
            offset, top = at - 1, nodes[:, PARENT] < LANES
            lanes = nodes[1:, PARENT][top[1:]]
            nodes = moved(nodes, offset)
            nodes[1:, PARENT][top[1:]] = LANES + first + lanes
            rows[first:end, CHILD] = members(nodes[0])[:, CHILD]
            further.append(nodes[1:])
            at += len(nodes) - 1
    is_dome = np.arange(count) >= ends[2]
    even = (rows[:, STRENGTH] > 0.0) & (~is_dome | (rows[:, ROUND] > 0.0))
    rows[:, EVEN] = even * (EVEN_PART / max(int(even.sum()), 1))
    places = np.arange(count)
    nodes = _nodes(rows, places // LANES, places % LANES, np.zeros(used - 1, np.int64))
    header[[H_LAMPS, H_PORTALS, H_DISTANTS, H_DOMES]] = ends
    header[H_CHOICE] = count > 1 or len(further) > 0
    header[H_NODES] = used - 1
    header[H_PLACED_NODES] = -(-int(ends[2]) // LANES)
    return np.concatenate([header[None], nodes, *further])

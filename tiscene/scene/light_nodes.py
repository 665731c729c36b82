"""What lights are chosen by: nodes, each a light or a group of lights, with about what it gives where.

Row 0 is a header. Then come the *entries*, which every choice looks at one by one: lights that have a place, portals,
distant lights, domes. Many lights of a sort are in groups of groups of two, whose members follow after the entries; a
choice looks at the members of a group that is near (Conty Estevez and Kulla, "Importance Sampling of Many Lights with
Adaptive Tree Splitting", 2018). The same nodes say which lights a ray can meet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Columns. NORMAL: against which a flat light shines. To a point at distance d and at height h against the normal a node
# gives STRENGTH * (ROUND * d + max(h, -BACK * h)) / (d * (d * d + SIZE2)), about the irradiance by luminance, W/m²;
# where BACK is CONE, its light has a cone besides. EVEN: the least chance of a node that a choice looks at. ROW: the
# light's, or -1 for a group. CHILD: the first of a group's two members, which stand together; else 0. PARENT: 0 for an
# entry. RADIUS2: of the sphere about the centre that holds it, -1 for a light that no ray meets. NEXT: where a ray that
# is done with a node and its members looks next, 0 for the end.
# Of a dome ROUND is 1 where it has no portals; SIZE2: its part of samples by its image, over that by its portals.
NODE_COLUMNS = 16
CENTRE, NORMAL, ROUND, STRENGTH, SIZE2, BACK, EVEN, ROW, CHILD, PARENT, RADIUS2, NEXT = 0, 3, 6, 7, 8, 9, *range(10, 16)
CONE = -1.0

# Columns of the header: where the entries of a sort end; the first node that a ray can meet (0: none), and how many
# lights it can; the rows where distant lights, domes and portals begin, and where they end; where those of meshes end.
H_LAMPS, H_PORTALS, H_DISTANTS, H_DOMES, H_SOLID, H_SOLID_COUNT, H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW = range(9)
H_ROWS, H_END = 9, 10

# A choice looks at so many nodes of lamps at most; they are entries one by one, or one group; and at so many of each
# other sort.
FEW = 32
FEW_OTHERS = 8
MOST_ENTRIES = FEW + 3 * FEW_OTHERS
# This part of the choices is even, for what the estimates do not know of.
EVEN_PART = 0.1
# Whoever is so far away, squared, is as far away from everywhere.
FAR2 = 1e16
# A group is never as flat as its members: one that faces a point may be in it where the others do not.
_FLATTEST = 0.8


def tree(leaves: NDArray[np.float32]) -> NDArray[np.float32]:
    """The 2n - 1 nodes of a tree over n leaves, level by level, the root first; groups are halved along their longest
    side. CHILD and PARENT count from the root.
    """
    nodes = np.zeros((2 * len(leaves) - 1, NODE_COLUMNS), np.float32)
    parents = np.zeros(len(nodes), np.int64)
    order, starts, places, used = np.arange(len(leaves)), np.array([0]), np.array([0]), 1
    while len(places):
        nodes[places] = leaves[order[starts]]  # which is right for those that are alone
        counts = np.diff(starts, append=len(order))
        many = counts > 1
        order, places, counts = order[np.repeat(many, counts)], places[many], counts[many]
        if len(places) == 0:
            break
        starts = np.cumsum(counts) - counts
        of = np.repeat(np.arange(len(places)), counts)
        nodes[places] = _groups(leaves[order].astype(np.float64), starts, of)

        positions = leaves[order, CENTRE : CENTRE + 3]
        extents = np.maximum.reduceat(positions, starts) - np.minimum.reduceat(positions, starts)
        order = order[np.lexsort((positions[np.arange(len(order)), extents.argmax(axis=1)[of]], of))]
        children = used + 2 * np.arange(len(places))
        used += 2 * len(places)
        nodes[places, CHILD] = children
        parents[children] = parents[children + 1] = places
        starts = np.stack([starts, starts + (counts + 1) // 2], axis=1).ravel()
        places = np.stack([children, children + 1], axis=1).ravel()
    nodes[:, PARENT] = parents
    return nodes


def moved(nodes: NDArray[np.float32], offset: int) -> NDArray[np.float32]:
    """A whole tree so many rows further on."""
    result = nodes.copy()
    result[:, CHILD] += np.where(result[:, CHILD] > 0.0, offset, 0)
    result[1:, PARENT] += offset
    return result


def _groups(members: NDArray[np.float64], starts: NDArray[np.int64], of: NDArray[np.int64]) -> NDArray[np.float64]:
    """Nodes for groups of members that stand together. starts: of each group; of: of each member its group."""
    result = np.zeros((len(starts), NODE_COLUMNS))
    strength = np.add.reduceat(members[:, STRENGTH], starts)
    weight = np.where(strength[of] > 0.0, members[:, STRENGTH], 1.0)
    weight = (weight / np.add.reduceat(weight, starts)[of])[:, None]
    centre = np.add.reduceat(weight * members[:, CENTRE : CENTRE + 3], starts)
    offset2 = ((members[:, CENTRE : CENTRE + 3] - centre[of]) ** 2).sum(axis=1)
    normals = members[:, NORMAL : NORMAL + 3]
    both_sides = members[:, BACK] > 0.5
    opposite = both_sides & ((normals * normals[starts][of]).sum(axis=1) < 0.0)
    normals = np.where(opposite[:, None], -normals, normals)
    result[:, CENTRE : CENTRE + 3] = centre
    result[:, NORMAL : NORMAL + 3] = _FLATTEST * np.add.reduceat(weight * normals, starts)
    result[:, ROUND] = 1.0 - np.linalg.norm(result[:, NORMAL : NORMAL + 3], axis=1)
    result[:, STRENGTH] = strength
    result[:, SIZE2] = np.add.reduceat(weight[:, 0] * (offset2 + members[:, SIZE2]), starts)
    result[:, BACK] = np.maximum.reduceat(np.maximum(members[:, BACK], 0.0), starts)
    reach = np.sqrt(offset2) + np.sqrt(np.maximum(members[:, RADIUS2], 0.0))
    result[:, RADIUS2] = np.maximum.reduceat(reach, starts) ** 2
    result[:, ROW] = -1.0
    return result


def assembled(
    lamps: NDArray[np.float32], portals: NDArray[np.float32], distants: NDArray[np.float32], domes: NDArray[np.float32]
) -> NDArray[np.float32]:
    """All nodes, from those of the lights of each sort: f32 [n, 16]. The header's counts of rows are still zero."""
    header = np.zeros((1, NODE_COLUMNS), np.float32)
    entries: list[NDArray[np.float32]] = [header]
    members: list[NDArray[np.float32]] = []
    others = ((leaves, FEW_OTHERS, FEW_OTHERS) for leaves in (portals, distants, domes))
    sorts = ((lamps, FEW, 1), *others)
    at = 1 + sum(len(leaves) if len(leaves) <= few else groups for leaves, few, groups in sorts)
    for column, (leaves, few, groups) in enumerate(sorts):
        here = header[0, column - 1] if column else 1
        if len(leaves) > few:
            nodes = tree(leaves)
            above, below = groups - 1, 2 * groups - 1  # a whole level of nodes becomes the entries
            places = np.concatenate([np.zeros(above), here + np.arange(groups), at + np.arange(len(nodes) - below)])
            nodes[:, CHILD] = np.where(nodes[:, CHILD] > 0.0, places[nodes[:, CHILD].astype(int)], 0.0)
            nodes[:, PARENT] = places[nodes[:, PARENT].astype(int)]
            nodes[:below, PARENT] = 0.0
            leaves, rest = nodes[above:below], nodes[below:]
            members.append(rest)
            at += len(rest)
        entries.append(leaves)
        header[0, column] = here + len(leaves)
    nodes = np.concatenate([*entries, *members])
    given = nodes[1 : int(header[0, H_DOMES])]
    even = (given[:, STRENGTH] > 0.0) & ((np.arange(len(given)) < header[0, H_DISTANTS] - 1) | (given[:, ROUND] > 0.0))
    given[:, EVEN] = even * (EVEN_PART / max(int(even.sum()), 1))
    for node in np.flatnonzero(nodes[:, CHILD] > 0.0):
        child = int(nodes[node, CHILD])
        nodes[child : child + 2, EVEN] = 0.5 * nodes[node, EVEN]
    nodes[0] = header[0]
    _link(nodes)
    return nodes


def _link(nodes: NDArray[np.float32]) -> None:
    """Fill in NEXT, and in the header what a ray can meet."""
    solid = np.flatnonzero(nodes[: int(nodes[0, H_LAMPS]), RADIUS2] >= 0.0)
    solid = solid[solid > 0]
    if len(solid) == 0:
        return
    nodes[0, H_SOLID] = solid[0]
    nodes[solid[:-1], NEXT] = solid[1:]
    waiting = [int(entry) for entry in solid]
    count = 0
    while waiting:
        node = waiting.pop()
        child = int(nodes[node, CHILD])
        if child == 0:
            count += int(nodes[node, RADIUS2] >= 0.0)
        else:
            nodes[child, NEXT], nodes[child + 1, NEXT] = child + 1, nodes[node, NEXT]
            waiting += [child, child + 1]
    nodes[0, H_SOLID] *= count > 0
    nodes[0, H_SOLID_COUNT] = count

"""Kernels that build a bounding volume hierarchy: binned surface-area heuristic (Wald 2007), nodes of 8 or 2 children.

A build runs `load`, `grow` (once for the top of the tree, once for the subtrees in parallel), `collapse` and one of the
`write_*` kernels. A binary node that covers n primitives owns the 2n - 1 slots from its own on, left child next to it,
so that subtrees are numbered without talking to each other and the tree is the same for any number of threads.
"""

import taichi as ti

BINS = 16
SAH_DEPTH = 40  # below it ranges are halved, which bounds the depth: 40 + log2(primitives) < STACK
STACK = 72
NAME, PACK, ROWS = 0, 1, 2  # what a leaf refers to: its only primitive, one pack of all, a row for each
FAR = 1e30  # an empty box is [FAR, -FAR]

Floats = ti.types.ndarray(ti.f32, 2)
Ints = ti.types.ndarray(ti.i32, 2)
Column = ti.types.ndarray(ti.i32, 1)
vec8 = ti.types.vector(8, ti.f32)
vec4 = ti.types.vector(4, ti.f32)
Wide = ti.types.ndarray(vec8, 1)
Packs = ti.types.ndarray(vec4, 1)


@ti.func
def half_area(low: ti.template(), high: ti.template()) -> ti.f32:
    size = high - low
    return size.x * size.y + size.y * size.z + size.z * size.x


@ti.func
def box_of(boxes: ti.template(), row: ti.i32):
    low = ti.Vector([boxes[row, 0], boxes[row, 1], boxes[row, 2]])
    high = ti.Vector([boxes[row, 3], boxes[row, 4], boxes[row, 5]])
    return low, high


@ti.func
def bin_of(boxes: ti.template(), row: ti.i32, axis: ti.i32, low: ti.f32, scale: ti.f32) -> ti.i32:
    return ti.min(BINS - 1, ti.max(0, ti.cast((boxes[row, axis] + boxes[row, 3 + axis] - low) * scale, ti.i32)))


@ti.func
def blocks(count: ti.i32, block: ti.i32) -> ti.f32:
    """What `count` primitives cost: they are tested in blocks."""
    return ti.cast((count + block - 1) // block, ti.f32)


@ti.func
def choose_split(
    boxes: ti.template(), begin: ti.i32, end: ti.i32, low: ti.template(), size: ti.template(), block: ti.i32
):
    """The axis, last bin of the left side and cost of the cheapest of the 3 * (BINS - 1) planes; axis -1 for none."""
    best = ti.math.inf
    best_axis = -1
    best_bin = 0
    count = ti.Vector([0] * BINS)
    right = ti.Vector([0.0] * BINS)
    lows = ti.Matrix([[FAR] * 3] * BINS)
    highs = ti.Matrix([[-FAR] * 3] * BINS)
    for axis in range(3):
        if size[axis] > 1e-30:
            scale = BINS * 0.99999 / size[axis]
            for b in range(BINS):
                count[b] = 0
                for c in ti.static(range(3)):
                    lows[b, c] = FAR
                    highs[b, c] = -FAR
            for i in range(begin, end):
                b = bin_of(boxes, i, axis, low[axis], scale)
                count[b] += 1
                for c in ti.static(range(3)):
                    lows[b, c] = ti.min(lows[b, c], boxes[i, c])
                    highs[b, c] = ti.max(highs[b, c], boxes[i, 3 + c])
            box_low = ti.Vector([FAR, FAR, FAR])
            box_high = -box_low
            total = 0
            for step in range(BINS - 1):
                b = BINS - 1 - step
                total += count[b]
                for c in ti.static(range(3)):
                    box_low[c] = ti.min(box_low[c], lows[b, c])
                    box_high[c] = ti.max(box_high[c], highs[b, c])
                right[b] = 0.0
                if total > 0:
                    right[b] = half_area(box_low, box_high) * blocks(total, block)
            box_low = ti.Vector([FAR, FAR, FAR])
            box_high = -box_low
            total = 0
            for b in range(BINS - 1):
                total += count[b]
                for c in ti.static(range(3)):
                    box_low[c] = ti.min(box_low[c], lows[b, c])
                    box_high[c] = ti.max(box_high[c], highs[b, c])
                if total > 0 and total < end - begin:
                    cost = half_area(box_low, box_high) * blocks(total, block) + right[b + 1]
                    if cost < best:
                        best = cost
                        best_axis = axis
                        best_bin = b
    return best_axis, best_bin, best


@ti.func
def partition(boxes: ti.template(), order: ti.template(), begin: ti.i32, end: ti.i32, axis, last, low: ti.f32, scale):
    """Move the primitives of bins 0 to `last` to the front; returns where the others begin."""
    i = begin
    j = end - 1
    while i <= j:
        if bin_of(boxes, i, axis, low, scale) <= last:
            i += 1
        else:
            for c in ti.static(range(6)):
                boxes[i, c], boxes[j, c] = boxes[j, c], boxes[i, c]
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@ti.func
def split(
    boxes: ti.template(),
    order: ti.template(),
    node_box: ti.template(),
    slot: ti.i32,
    begin: ti.i32,
    end: ti.i32,
    depth: ti.i32,
    sah_depth: ti.i32,
    leaf_size: ti.i32,
    block: ti.i32,
    node_cost: ti.f32,
) -> ti.i32:
    """Set the node's box; sort its primitives into two sides and return where the second begins, -1 for a leaf."""
    low = ti.Vector([FAR, FAR, FAR])
    high = -low
    centre_low = low
    centre_high = -low
    for i in range(begin, end):
        for c in ti.static(range(3)):
            a = boxes[i, c]
            b = boxes[i, 3 + c]
            low[c] = ti.min(low[c], a)
            high[c] = ti.max(high[c], b)
            centre_low[c] = ti.min(centre_low[c], a + b)
            centre_high[c] = ti.max(centre_high[c], a + b)
    for c in ti.static(range(3)):
        node_box[slot, c] = low[c]
        node_box[slot, 3 + c] = high[c]
    middle = -1
    count = end - begin
    if count > 1:
        size = centre_high - centre_low
        axis = -1
        last = 0
        cost = 0.0
        if depth < sah_depth and count > 2:
            axis, last, cost = choose_split(boxes, begin, end, centre_low, size, block)
        area = half_area(low, high)
        worthwhile = axis >= 0 and cost + node_cost * area < area * blocks(count, block)
        if worthwhile or count > leaf_size:
            middle = (begin + end) // 2
            if axis >= 0:
                scale = BINS * 0.99999 / size[axis]
                middle = partition(boxes, order, begin, end, axis, last, centre_low[axis], scale)
    return middle


@ti.kernel
def load(given_boxes: Floats, given_order: Column, boxes: Floats, order: Column, tasks: Ints):
    """Copy host arrays into the working arrays, which may be larger, and make the whole of them the first task."""
    for i in range(given_order.shape[0]):
        if i == 0:
            for c in ti.static(range(4)):
                tasks[0, c] = 0
            tasks[0, 2] = given_order.shape[0]
        order[i] = given_order[i]
        for c in ti.static(range(6)):
            boxes[i, c] = given_boxes[i, c]


@ti.kernel
def grow(
    boxes: Floats,
    order: Column,
    node_box: Floats,
    node_link: Ints,
    tasks: Ints,
    first: ti.i32,
    count: ti.i32,
    stop: ti.i32,
    sah_depth: ti.i32,
    leaf_size: ti.i32,
    block: ti.i32,
    node_cost: ti.f32,
) -> ti.i32:
    """Grow the binary tree below `tasks[first .. first + count)`, rows of (slot, begin, end, depth).

    Ranges of at most `stop` primitives are not split but appended as tasks, which is only right when count is 1;
    returns how many. sah_depth: below this depth ranges are halved, without looking at areas. leaf_size: most
    primitives in a leaf. block: how many are tested at once. node_cost: a node visited, in units of one block tested.
    node_link: left slot (-1 for a leaf), right slot, first primitive, number of primitives.
    """
    found = 0
    ti.loop_config(block_dim=1)
    for task in range(first, first + count):
        stack = ti.Matrix([[0] * 4] * STACK)
        for c in ti.static(range(4)):
            stack[0, c] = tasks[task, c]
        depth_of_stack = 1
        while depth_of_stack > 0:
            top = depth_of_stack - 1
            slot = stack[top, 0]
            begin = stack[top, 1]
            end = stack[top, 2]
            depth = stack[top, 3]
            depth_of_stack -= 1
            if end - begin <= stop:
                for c in ti.static(range(4)):
                    tasks[first + count + found, c] = stack[top, c]
                found += 1
            else:
                middle = split(boxes, order, node_box, slot, begin, end, depth, sah_depth, leaf_size, block, node_cost)
                node_link[slot, 0] = -1
                node_link[slot, 1] = -1
                node_link[slot, 2] = begin
                node_link[slot, 3] = end - begin
                if middle >= 0:
                    left = slot + 1
                    right = slot + 2 * (middle - begin)
                    node_link[slot, 0] = left
                    node_link[slot, 1] = right
                    for side, s, b, e in ti.static(((0, right, middle, end), (1, left, begin, middle))):
                        stack[top + side, 0] = s
                        stack[top + side, 1] = b
                        stack[top + side, 2] = e
                        stack[top + side, 3] = depth + 1
                    depth_of_stack += 2
    return found


@ti.kernel
def collapse(
    order: Column,
    node_box: Floats,
    node_link: Ints,
    children: Ints,
    stack: Ints,
    totals: Column,
    width: ti.i32,
    leaf_kind: ti.i32,
    by_count: ti.i32,
):
    """Merge binary nodes into nodes of up to `width` children, numbered depth first.

    children[node]: slots, -1 for none. The child with the largest area (by_count: the most primitives) is opened first.
    In node_link column 2 of an inner slot becomes its wide node, column 1 of a leaf what `leaf_kind` says.
    totals: nodes, packs, most entries that a traversal can have on its stack.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        nodes = 0
        packs = 0
        deepest = 0
        stack[0, 0] = 0
        stack[0, 1] = 0
        waiting = 1
        while waiting > 0:
            waiting -= 1
            slot = stack[waiting, 0]
            below = stack[waiting, 1]
            opened = ti.Vector([-1] * 8)
            opened[0] = slot
            count = 1
            candidate = 0
            while candidate >= 0 and count < width:
                candidate = -1
                largest = -1.0
                for k in range(count):
                    s = opened[k]
                    if node_link[s, 0] >= 0:
                        low, high = box_of(node_box, s)
                        measure = half_area(low, high)
                        if by_count > 0:
                            measure = ti.cast(node_link[s, 3], ti.f32)
                        if measure > largest:
                            largest = measure
                            candidate = k
                if candidate >= 0:
                    s = opened[candidate]
                    opened[candidate] = node_link[s, 0]
                    opened[count] = node_link[s, 1]
                    count += 1
            if node_link[slot, 0] >= 0:
                node_link[slot, 2] = nodes
            below += count - 1
            deepest = ti.max(deepest, below)
            for k in range(8):
                s = opened[k]
                children[nodes, k] = s
                if s >= 0:
                    if node_link[s, 0] >= 0:
                        stack[waiting, 0] = s
                        stack[waiting, 1] = below
                        waiting += 1
                    elif leaf_kind == NAME:
                        node_link[s, 1] = order[node_link[s, 2]]
                    elif leaf_kind == PACK:
                        node_link[s, 1] = packs
                        packs += 1
                    else:
                        node_link[s, 1] = node_link[s, 2]
            nodes += 1
        totals[0] = nodes
        totals[1] = packs
        totals[2] = deepest


@ti.kernel
def write_wide_nodes(
    node_box: Floats,
    node_link: Ints,
    children: Ints,
    count: ti.i32,
    nodes: Wide,
    first_node: ti.i32,
    first_leaf: ti.i32,
    leaf_rows: ti.i32,
):
    """Eight rows a node: least x, y, z, greatest x, y, z, references (bits of int32), nothing; a lane for each child.

    A reference is the first row of an inner node, or -1 - row of a leaf: `leaf_rows` rows each from `first_leaf` on.
    """
    for node in range(count):
        at = 8 * (first_node + node)
        for k in ti.static(range(8)):
            for c in ti.static(range(3)):
                nodes[at + c][k] = FAR
                nodes[at + 3 + c][k] = -FAR
            nodes[at + 6][k] = 0.0
            nodes[at + 7][k] = 0.0
            slot = children[node, k]
            if slot >= 0:
                for c in ti.static(range(6)):
                    nodes[at + c][k] = node_box[slot, c]
                reference = 8 * (first_node + node_link[slot, 2])
                if node_link[slot, 0] < 0:
                    reference = -1 - (first_leaf + node_link[slot, 1]) * leaf_rows
                nodes[at + 6][k] = ti.bit_cast(reference, ti.f32)


@ti.kernel
def write_packs(
    positions: Floats,
    triangles: Ints,
    order: Column,
    node_link: Ints,
    children: Ints,
    count: ti.i32,
    packs: Packs,
    first_pack: ti.i32,
    first_triangle: ti.i32,
):
    """Ten rows a pack of up to four triangles: vertex 0, edge 1, edge 2, global triangle (bits of int32), ascending."""
    for node, k in ti.ndrange(count, 8):
        slot = children[node, k]
        if slot >= 0:
            if node_link[slot, 0] < 0:
                at = 10 * (first_pack + node_link[slot, 1])
                begin = node_link[slot, 2]
                size = node_link[slot, 3]
                sort(order, begin, begin + size)
                for lane in ti.static(range(4)):
                    for row in ti.static(range(9)):
                        packs[at + row][lane] = 0.0
                    triangle = -1
                    if lane < size:
                        local = order[begin + lane]
                        triangle = first_triangle + local
                        for c in ti.static(range(3)):
                            origin = positions[triangles[local, 0], c]
                            packs[at + c][lane] = origin
                            packs[at + 3 + c][lane] = positions[triangles[local, 1], c] - origin
                            packs[at + 6 + c][lane] = positions[triangles[local, 2], c] - origin
                    packs[at + 9][lane] = ti.bit_cast(triangle, ti.f32)


@ti.func
def sort(order: ti.template(), begin: ti.i32, end: ti.i32):
    for i in range(begin + 1, end):
        j = i
        while j > begin and order[j - 1] > order[j]:
            order[j - 1], order[j] = order[j], order[j - 1]
            j -= 1


@ti.kernel
def write_binary_nodes(
    node_box: Floats,
    node_link: Ints,
    children: Ints,
    count: ti.i32,
    nodes: Floats,
    first_node: ti.i32,
    first_leaf: ti.i32,
):
    """Sixteen numbers a node: the boxes of two children (least x, y, z, greatest x, y, z), their references, nothing.

    A reference is an inner node, or -1 - (4 * first row + rows - 1) of a leaf.
    """
    for node, k in ti.ndrange(count, 2):
        at = first_node + node
        for c in ti.static(range(3)):
            nodes[at, 6 * k + c] = ti.math.inf  # a box that no ray reaches, whichever way it goes
            nodes[at, 6 * k + 3 + c] = ti.math.inf
        nodes[at, 12 + k] = 0.0
        nodes[at, 14 + k] = 0.0
        slot = children[node, k]
        if slot >= 0:
            for c in ti.static(range(6)):
                nodes[at, 6 * k + c] = node_box[slot, c]
            reference = first_node + node_link[slot, 2]
            if node_link[slot, 0] < 0:
                reference = -4 * (first_leaf + node_link[slot, 1]) - node_link[slot, 3]
            nodes[at, 12 + k] = ti.bit_cast(reference, ti.f32)


@ti.kernel
def write_triangles(
    positions: Floats,
    triangles: Ints,
    order: Column,
    count: ti.i32,
    rows: Floats,
    first_row: ti.i32,
    first_triangle: ti.i32,
):
    """Twelve numbers a triangle in the order of the leaves: vertex 0, global triangle (bits), edge 1, 0, edge 2, 0."""
    for i in range(count):
        local = order[i]
        at = first_row + i
        rows[at, 3] = ti.bit_cast(first_triangle + local, ti.f32)
        rows[at, 7] = 0.0
        rows[at, 11] = 0.0
        for c in ti.static(range(3)):
            origin = positions[triangles[local, 0], c]
            rows[at, c] = origin
            rows[at, 4 + c] = positions[triangles[local, 1], c] - origin
            rows[at, 8 + c] = positions[triangles[local, 2], c] - origin

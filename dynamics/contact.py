"""Spheres against triangles: how far away they are, and when a moving sphere first touches one.

Device functions, over the two-level tree of `dynamics.obstacles`. Everything is float32 and relative to the sphere's
centre, so that only the last subtraction rounds. (No postponed annotations in this module.)
"""

import taichi as ti

from dynamics.obstacles import FACTOR, METRES

vec3 = ti.types.vector(3, ti.f32)
Floats = ti.types.ndarray(ti.f32, 2)
Ints = ti.types.ndarray(ti.i32, 2)
Column = ti.types.ndarray(ti.i32, 1)

STACK = 72  # what the builder of the trees keeps to
FAR = 1e30
SKIN = 5e-4  # m: the gap that motion stops at
TOLERANCE = 2e-5  # m: nearer than this to that gap counts as touching
SLIDE = 2e-6  # m: approach that counts as sliding along
ITERATIONS = 16

# What a sphere meets. WAIT: the share of a gap to a mover that is still too far away to be touched.
NOTHING, OBSTACLE, MOVER, WALL, WAIT = 0, 1, 2, 3, 4

# A touch: normal (towards the sphere), arm (from the body's origin to the sphere), gap, kind.
TOUCHES = 16  # most that a group of spheres keeps
NORMAL, ARM, GAP, TOUCH_KIND, TOUCH_COLUMNS = 0, 3, 6, 7, 8


@ti.func
def vector_at(table: ti.template(), row: ti.i32, column: ti.i32):
    return vec3(table[row, column], table[row, column + 1], table[row, column + 2])


@ti.func
def nearest_on_edge(start, edge):
    """The point of the segment from `start` along `edge` that is nearest to the origin."""
    along = ti.min(ti.max(-start.dot(edge) / ti.max(edge.dot(edge), 1e-30), 0.0), 1.0)
    return start + along * edge


@ti.func
def nearest_on_triangle(corner, edge_1, edge_2):
    """The point of a triangle that is nearest to the origin.

    Edges count even where the interior claims to be nearer, so that slivers cannot make the distance too large.
    """
    best = nearest_on_edge(corner, edge_1)
    for point in ti.static(
        (nearest_on_edge(corner, edge_2), nearest_on_edge(corner + edge_1, edge_2 - edge_1)),
    ):
        if point.dot(point) < best.dot(best):
            best = point
    normal = edge_1.cross(edge_2)
    square = ti.max(normal.dot(normal), 1e-30)
    u = edge_2.cross(corner).dot(normal) / square
    v = corner.cross(edge_1).dot(normal) / square
    if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
        foot = normal * (corner.dot(normal) / square)
        if foot.dot(foot) < best.dot(best):
            best = foot
    return best


@ti.func
def mapped(instances: ti.template(), row: ti.i32, column: ti.i32, v, w: ti.f32):
    """A point (w = 1) or a direction (w = 0) by the matrix in `column` of an instance."""
    result = vec3(0.0)
    for i in ti.static(range(3)):
        at = column + ti.static(4 * i)
        result[i] = (
            instances[row, at] * v[0]
            + instances[row, at + 1] * v[1]
            + instances[row, at + 2] * v[2]
            + instances[row, at + 3] * w
        )
    return result


@ti.func
def box_gap(nodes: ti.template(), node: ti.i32, at: ti.i32, centre, half):
    """How far the box at column `at` of a node is outside of [centre - half, centre + half], along each axis."""
    gap = vec3(0.0)
    for i in ti.static(range(3)):
        outside = ti.max(nodes[node, at + i] - centre[i], centre[i] - nodes[node, at + 3 + i])
        gap[i] = ti.max(outside - half[i], 0.0)
    return gap


@ti.func
def record(touches: ti.template(), base: ti.i32, count: ti.i32, normal, arm, gap: ti.f32, kind: ti.i32) -> ti.i32:
    """Keep a touch among those of a group; of similar ones of one sphere the nearer. Returns how many there are."""
    slot = -1
    worst = 0
    for i in range(count):
        row = base + i
        if slot < 0:
            if (vector_at(touches, row, ARM) - arm).norm() < 1e-6 and vector_at(touches, row, NORMAL).dot(normal) > 0.9:
                slot = i
        if touches[row, GAP] > touches[base + worst, GAP]:
            worst = i
    result = count
    if slot < 0:
        slot = worst
        if count < TOUCHES:
            slot = count
            result = count + 1
            touches[base + slot, GAP] = FAR
    if gap < touches[base + slot, GAP]:
        for i in ti.static(range(3)):
            touches[base + slot, NORMAL + i] = normal[i]
            touches[base + slot, ARM + i] = arm[i]
        touches[base + slot, GAP] = gap
        touches[base + slot, TOUCH_KIND] = ti.cast(kind, ti.f32)
    return result


@ti.func
def first_contact(corner, edge_1, edge_2, chord, radius: ti.f32, slack: ti.f32, inward, until: ti.f32):
    """When (0 .. until) a sphere of `radius` + SKIN that moves from the origin along `chord` touches a triangle.

    Returns the time, FAR for never; the normal there; the normal and the gap at the start. inward: points from the
    sphere into the body that it belongs to. slack: how far the true path may bend away from the chord, m.

    Newton's method on the distance, which is a convex function of time: every step goes to where the sphere would
    touch the plane through the nearest point, so it never goes too far and never enters the triangle.
    """
    stop = radius + SKIN
    time = FAR
    reached = 0.0
    normal = vec3(0.0)
    start_normal = normal
    start_gap = 0.0
    searching = True
    for step in range(ITERATIONS):
        if searching:
            point = nearest_on_triangle(corner - reached * chord, edge_1, edge_2)
            distance = point.norm()
            normal = -point / ti.max(distance, 1e-9)
            if distance < 1e-6:
                # The centre lies on the triangle: the side on which the body is decides.
                normal = edge_1.cross(edge_2).normalized()
                if normal.dot(inward) < 0.0:
                    normal = -normal
            if step == 0:
                start_gap = distance - stop
                if start_gap < -0.5 * SKIN and normal.dot(inward) < 0.0:
                    # It was put there with its centre beyond the surface already: it has to come back.
                    normal = -normal
                    start_gap = -distance - stop
                start_normal = normal
            approach = -normal.dot(chord)
            if step == 0:
                if start_gap < TOLERANCE and approach > SLIDE:
                    time = 0.0
                elif start_gap < -0.5 * SKIN:
                    # Too near already: it must get away, even where its path bends back.
                    if approach > -4.0 * slack - 1e-9:
                        time = 0.0
                    searching = False
                if start_gap < TOLERANCE:
                    stop = radius + 0.5 * SKIN
                if time == 0.0:
                    searching = False
            elif approach > 0.0 and distance - stop < 0.5 * TOLERANCE:
                time = reached
                searching = False
            if approach <= 0.0:
                searching = False
            if searching:
                reached += ti.max(distance - stop, 0.0) / approach
                if reached >= until:
                    searching = False
    if searching:
        time = reached  # not settled in time: stop where it is still free
    return time, normal, start_normal, start_gap


@ti.func
def look_around(
    nodes: ti.template(),
    triangles: ti.template(),
    instances: ti.template(),
    roots: ti.template(),
    root: ti.i32,
    centre,
    chord,
    radius: ti.f32,
    limit: ti.f32,
    slack: ti.f32,
    band: ti.f32,
    arm,
    inward,
    touches: ti.template(),
    base: ti.i32,
    count: ti.i32,
    sweeping: ti.template(),
):
    """Walk the tree about a sphere.

    sweeping (static): find when, before `limit` (1 for the whole of `chord`), the sphere first touches anything, and
    keep as touches what is nearer than `band`. Otherwise: find the distance of its centre to the nearest
    triangle, or `limit` if there is none within. Returns that number, the normal, the instance and the touch count.
    """
    best = limit
    best_normal = vec3(0.0)
    best_instance = -1
    touched = count
    grown = radius + SKIN + band
    # The box that is looked through, in the space of the world or of an instance, and its metres a unit.
    middle = centre + 0.5 * chord
    half = 0.5 * ti.abs(chord) + grown
    metres = vec3(1.0)
    factor = 1.0
    if ti.static(not sweeping):
        half = vec3(0.0)
    stack = ti.Vector([0] * STACK)
    waiting = 0
    floor = -1  # entries below it belong to the upper tree; -1 while in it
    instance = -1
    current = root
    searching = True
    while searching:
        pop = False
        if current >= 0:
            left_gap = box_gap(nodes, current, 0, middle, half) * metres
            right_gap = box_gap(nodes, current, 6, middle, half) * metres
            left = ti.sqrt(factor * left_gap.dot(left_gap))
            right = ti.sqrt(factor * right_gap.dot(right_gap))
            near = ti.bit_cast(nodes[current, 12], ti.i32)
            far = ti.bit_cast(nodes[current, 13], ti.i32)
            if right < left:
                near, far = far, near
                left, right = right, left
            allowed = 0.0
            if ti.static(not sweeping):
                allowed = best
            if right <= allowed:
                stack[waiting] = far
                waiting += 1
            current = near
            pop = left > allowed
        elif floor < 0:
            instance = (-1 - current) // 4
            metres = vector_at(instances, instance, METRES)
            factor = instances[instance, FACTOR]
            middle = mapped(instances, instance, 12, centre + 0.5 * chord, 1.0)
            if ti.static(sweeping):
                half = 0.5 * ti.abs(mapped(instances, instance, 12, chord, 0.0)) + grown / metres
            floor = waiting
            current = roots[instance]
        else:
            code = -1 - current
            for row in range(code // 4, code // 4 + code % 4 + 1):
                corner = mapped(instances, instance, 0, vector_at(triangles, row, 0), 1.0) - centre
                edge_1 = mapped(instances, instance, 0, vector_at(triangles, row, 4), 0.0)
                edge_2 = mapped(instances, instance, 0, vector_at(triangles, row, 8), 0.0)
                if ti.static(sweeping):
                    time, normal, start_normal, start_gap = first_contact(
                        corner, edge_1, edge_2, chord, radius, slack, inward, best
                    )
                    if start_gap < band:
                        touched = record(touches, base, touched, start_normal, arm, start_gap, OBSTACLE)
                    if time < best:
                        best = time
                        best_normal = normal
                        best_instance = instance
                else:
                    best = ti.min(best, nearest_on_triangle(corner, edge_1, edge_2).norm())
            pop = True
        if pop:
            if waiting == floor:
                floor = -1
                middle = centre + 0.5 * chord
                metres = vec3(1.0)
                factor = 1.0
                if ti.static(sweeping):
                    half = 0.5 * ti.abs(chord) + grown
            if waiting == 0:
                searching = False
            else:
                waiting -= 1
                current = stack[waiting]
    return best, best_normal, best_instance, touched

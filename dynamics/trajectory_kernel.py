# SPDX-License-Identifier: Apache-2.0
"""Kernel that evaluates the closed-form trajectories of all bodies, in one launch and in float64.

Each body is computed by one thread from its own rows, so that poses depend neither on the number of threads nor on
other bodies. Float literals in kernels are float32, which represents those used here exactly; other constants come in
arrays.
"""

import taichi as ti

from dynamics.bodies import AIM, BY_COUNT, BY_LENGTH, CURVE
from dynamics.dynamic import LENGTH_STEPS, ROTATION
from dynamics.kernel_types import Doubles2, Ints2, Template


@ti.func
def multiply(a, b):
    """Hamilton product of quaternions (w, x, y, z)."""
    return ti.Vector(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


@ti.func
def rotate(q, v):
    """Return the vector `v` rotated by the unit quaternion `q`."""
    axis = ti.Vector([q[1], q[2], q[3]])
    twice = 2.0 * axis.cross(v)
    return v + q[0] * twice + axis.cross(twice)


@ti.func
def unit(q, otherwise):
    """Return the quaternion `q` scaled to length 1, or `otherwise` if it is zero."""
    length = q.norm()
    result = otherwise
    if length > 1e-12:
        result = q / length
    return result


@ti.func
def slerp(a, b, t):
    """Interpolate from `a` to `b` along the arc between them, without choosing a hemisphere.

    Between equal rotations the result is the same number at every `t`: what pauses must not tremble by rounding.
    """
    angle = 2.0 * ti.atan2((a - b).norm(), (a + b).norm())
    sine = ti.sin(angle)
    result = a + t * (b - a)
    if sine > 1e-8:
        result = ti.sin((1.0 - t) * angle) / sine * a + ti.sin(t * angle) / sine * b
    return unit(result, a)


@ti.func
def quaternion_at(segments: Template, row, column):
    """Return the quaternion in four consecutive columns of a segment."""
    return ti.Vector([segments[row, column + i] for i in ti.static(range(4))])


@ti.func
def cubic_at(segments: Template, row, column, t):
    """Evaluate at `t` the cubic whose coefficients are in twelve consecutive columns of a segment."""
    constant = ti.Vector([segments[row, column + i] for i in ti.static(range(3))])
    first = ti.Vector([segments[row, column + 3 + i] for i in ti.static(range(3))])
    second = ti.Vector([segments[row, column + 6 + i] for i in ti.static(range(3))])
    third = ti.Vector([segments[row, column + 9 + i] for i in ti.static(range(3))])
    return constant + t * (first + t * (second + t * third))


@ti.func
def speed_at(segments: Template, row, t):
    """Return the length of the position's derivative at `t`."""
    first = ti.Vector([segments[row, 3 + i] for i in ti.static(range(3))])
    second = ti.Vector([segments[row, 6 + i] for i in ti.static(range(3))])
    third = ti.Vector([segments[row, 9 + i] for i in ti.static(range(3))])
    return (first + t * (2.0 * second + t * (3.0 * third))).norm()


@ti.func
def segment_at(spans: Template, first, count, value):
    """Return the index (0..count - 1) of the segment whose span holds `value`, by bisection."""
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if spans[first + middle, 0] <= value:
            low = middle
        else:
            high = middle
    return low


@ti.func
def time_of_length(segments: Template, spans: Template, gauss: Template, row, length):
    """Return t at which the curve has reached the cumulative arc length `length` within the segment `row`.

    Looks up the step in the table of lengths, then applies Newton's method within the step.
    """
    step = 0
    while step < LENGTH_STEPS - 1 and spans[row, step + 1] <= length:
        step += 1
    start = ti.cast(step, ti.f64) / LENGTH_STEPS
    rest = length - spans[row, step]
    whole = spans[row, step + 1] - spans[row, step]
    inside = start * 0.0
    if whole > 0.0:
        inside = rest / whole / LENGTH_STEPS
        for _ in range(4):
            reached = start * 0.0
            for node in ti.static(range(5)):
                reached += gauss[1, node] * speed_at(segments, row, start + gauss[0, node] * inside)
            speed = speed_at(segments, row, start + inside)
            if speed > 0.0:
                inside += (rest - reached * inside) / speed
            inside = ti.min(ti.max(inside, 0.0), 1.0 / LENGTH_STEPS)
    return start + inside


@ti.func
def rotation_at(segments: Template, row, t, euler):
    """Return the rotation of the segment `row` at `t`: cubic Euler angles if `euler` is 1, else squad."""
    a = quaternion_at(segments, row, ROTATION)
    result = a
    if euler == 1:
        half = cubic_at(segments, row, ROTATION, t) * 0.5
        none = half[0] * 0.0
        about_x = ti.Vector([ti.cos(half[0]), ti.sin(half[0]), none, none])
        about_y = ti.Vector([ti.cos(half[1]), none, ti.sin(half[1]), none])
        about_z = ti.Vector([ti.cos(half[2]), none, none, ti.sin(half[2])])
        result = multiply(multiply(about_y, about_x), about_z)
    else:
        b = quaternion_at(segments, row, ROTATION + 4)
        inner_a = quaternion_at(segments, row, ROTATION + 8)
        inner_b = quaternion_at(segments, row, ROTATION + 12)
        # squad; equals slerp where inner and outer quaternions are equal.
        result = slerp(slerp(a, b, t), slerp(inner_a, inner_b, t), 2.0 * t * (1.0 - t))
    return result


@ti.func
def look_at_rotation(position, target, up, otherwise):
    """Return the rotation that turns -z from `position` to `target` and +y near `up`, or `otherwise` if undefined."""
    backward = position - target
    right = up.cross(backward)
    if right.norm() < 1e-9 * backward.norm():
        # The view direction is parallel to `up`: use a fixed other reference.
        right = ti.Vector([up[1], up[2], up[0]]).cross(backward)
    result = otherwise
    if backward.norm() > 1e-9 and right.norm() > 1e-12:
        z = backward / backward.norm()
        x = right / right.norm()
        y = z.cross(x)
        # Quaternion of the matrix (x, y, z), from the largest of its four components for accuracy.
        squares = ti.Vector(
            [1.0 + x[0] + y[1] + z[2], 1.0 + x[0] - y[1] - z[2], 1.0 - x[0] + y[1] - z[2], 1.0 - x[0] - y[1] + z[2]]
        )
        if squares[0] >= ti.max(squares[1], squares[2], squares[3]):
            result = ti.Vector([squares[0], y[2] - z[1], z[0] - x[2], x[1] - y[0]])
        elif squares[1] >= ti.max(squares[2], squares[3]):
            result = ti.Vector([y[2] - z[1], squares[1], x[1] + y[0], z[0] + x[2]])
        elif squares[2] >= squares[3]:
            result = ti.Vector([z[0] - x[2], x[1] + y[0], squares[2], y[2] + z[1]])
        else:
            result = ti.Vector([x[1] - y[0], z[0] + x[2], y[2] + z[1], squares[3]])
        result = unit(result, otherwise)
    return result


@ti.kernel
def evaluate(
    bodies: Ints2,
    tracks: Ints2,
    axes: Doubles2,
    segments: Doubles2,
    spans: Doubles2,
    gauss: Doubles2,
    parameters: Doubles2,
    poses: Doubles2,
):
    """Set `poses` [s n, 7] of n bodies at s times.

    The tables `bodies`, `tracks`, `axes`, `segments` and `spans` are those of `dynamics.bodies.BodyColumns`.

    Args:
        gauss: Nodes and weights of the quadrature, see `dynamics.quadrature`.
        parameters: [s, t], the parameter u of every track at every time.
        poses: Output, one time after another.
    """
    for row in range(poses.shape[0]):
        time = row // bodies.shape[0]
        body = row % bodies.shape[0]
        zero = ti.cast(0.0, ti.f64)
        one = ti.cast(1.0, ti.f64)
        position = ti.Vector([zero, zero, zero])
        rotation = ti.Vector([one, zero, zero, zero])
        for track in range(bodies[body, 0], bodies[body, 0] + bodies[body, 1]):
            u = parameters[time, track]
            axis = ti.Vector([axes[track, i] for i in ti.static(range(3))])
            if tracks[track, 0] == CURVE:
                first = tracks[track, 1]
                count = tracks[track, 2]
                segment = first
                t = u
                if tracks[track, 3] == BY_COUNT:
                    segment = first + ti.min(ti.cast(u, ti.i32), count - 1)
                    t = u - (segment - first)
                elif tracks[track, 3] == BY_LENGTH:
                    length = u * spans[first + count - 1, LENGTH_STEPS]
                    segment = first + segment_at(spans, first, count, length)
                    t = time_of_length(segments, spans, gauss, segment, length)
                else:
                    segment = first + segment_at(spans, first, count, u)
                    begin = spans[segment, 0]
                    t = ti.min(ti.max((u - begin) / (spans[segment, LENGTH_STEPS] - begin), 0.0), 1.0)
                position += rotate(rotation, cubic_at(segments, segment, 0, t))
                rotation = multiply(rotation, rotation_at(segments, segment, t, tracks[track, 4]))
            elif tracks[track, 0] == AIM:
                up = ti.Vector([axes[track, 3 + i] for i in ti.static(range(3))])
                rotation = look_at_rotation(position, axis, up, rotation)
            else:
                turn = ti.sin(0.5 * u) * axis
                rotation = multiply(rotation, ti.Vector([ti.cos(0.5 * u), turn[0], turn[1], turn[2]]))
        rotation = unit(rotation, rotation)
        for i in ti.static(range(3)):
            poses[row, i] = position[i]
        for i in ti.static(range(4)):
            poses[row, 3 + i] = rotation[i]

"""Paths side by side: a number is a vector with a lane for each path, a point or a direction a Triple of such numbers.

For kernels in `device.vector_mode`, in which LLVM makes SIMD of them. Where one path would branch, both ways are
computed and `ti.select` takes one. In the same order as for one path, the same operations give every lane its bits.
"""

from typing import Any

import taichi as ti
from taichi.lang import impl

from tiscene.render import warp
from tiscene.render.intersect.wide import larger

LANES = 16
Floats = ti.types.vector(LANES, ti.f32)
Words = ti.types.vector(LANES, ti.u32)


class Bundle:
    """Values by name, each a variable of its own, which functions of a kernel hand on as they are."""

    _data_oriented = True  # Taichi copies everything else, and makes named tuples plain
    _is_wrapped_kernel = True  # else it warns of each call

    def __init__(self, **values: Any) -> None:
        self.__dict__.update({name: impl.expr_init(value) for name, value in values.items()})


class Triple(Bundle):
    """Three coordinates, each a number or lanes of them. As a vec3, but for numbers that stand before it."""

    def __init__(self, x: Any, y: Any, z: Any) -> None:
        super().__init__(x=x, y=y, z=z)

    def __add__(self, other: Any) -> "Triple":
        return Triple(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Any) -> "Triple":
        return Triple(self.x - other.x, self.y - other.y, self.z - other.z)

    def __mul__(self, other: Any) -> "Triple":
        by = other if isinstance(other, Triple) else Bundle(x=other, y=other, z=other)
        return Triple(self.x * by.x, self.y * by.y, self.z * by.z)

    def __truediv__(self, other: Any) -> "Triple":
        return Triple(self.x / other, self.y / other, self.z / other)


@ti.func
def zeros():
    """Room for three coordinates of every path."""
    return Triple(Floats(0.0), Floats(0.0), Floats(0.0))


@ti.func
def put(triple: ti.template(), lane: ti.i32, v: ti.math.vec3):
    """The coordinates of one path."""
    triple.x[lane] = v.x
    triple.y[lane] = v.y
    triple.z[lane] = v.z


@ti.func
def triple_of(v: ti.math.vec3):
    """The same for all paths."""
    return Triple(v.x, v.y, v.z)


@ti.func
def of_lane(triple: ti.template(), lane: ti.i32) -> ti.math.vec3:
    return ti.math.vec3(triple.x[lane], triple.y[lane], triple.z[lane])


@ti.func
def where(condition):
    """1 in the lanes where it holds, else 0. Products of these are both; comparisons have no lanes to read."""
    return ti.select(condition, Floats(1.0), Floats(0.0))


@ti.func
def choose(condition, a: ti.template(), b: ti.template()):
    """Of two Triples, the first where it holds."""
    return Triple(ti.select(condition, a.x, b.x), ti.select(condition, a.y, b.y), ti.select(condition, a.z, b.z))


@ti.func
def magnitude(a):
    return larger(a, 0.0 - a)


@ti.func
def largest(a: ti.template()):
    """Of three coordinates."""
    return larger(larger(a.x, a.y), a.z)


@ti.func
def magnitudes(a: ti.template()):
    return Triple(magnitude(a.x), magnitude(a.y), magnitude(a.z))


@ti.func
def dot(a: ti.template(), b: ti.template()):
    return a.x * b.x + a.y * b.y + a.z * b.z


@ti.func
def cross(a: ti.template(), b: ti.template()):
    return Triple(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@ti.func
def length(a: ti.template()):
    return ti.sqrt(dot(a, a))


@ti.func
def unit_or(a: ti.template(), otherwise: ti.template()):
    """As `surface.unit_or`."""
    size = length(a)
    return choose(size > 0.0, a / size, otherwise)


@ti.func
def combined(a: ti.template(), b: ti.template(), c: ti.template(), w: ti.template()):
    """The sum of three vectors by three weights."""
    return a * w.x + b * w.y + c * w.z


@ti.func
def along_axes(a: ti.template(), b: ti.template(), c: ti.template(), w: ti.template()):
    """The dot products of w with three vectors."""
    return Triple(dot(a, w), dot(b, w), dot(c, w))


@ti.func
def cosine_hemisphere(n: ti.template(), u: ti.template(), v: ti.template()):
    """(a direction by `warp.cosine_hemisphere` about n, in the frame of `warp.tangents`; its cosine)."""
    one = Floats(1.0)
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    flat = magnitude(x) > magnitude(y)
    radius, other = ti.select(flat, x, y), ti.select(flat, y, x)
    cosine, sine = warp.on_arc(radius, 0.125 * other / ti.select(radius == 0.0, one, radius))
    p, q = ti.select(flat, cosine, sine), ti.select(flat, sine, cosine)
    height = ti.sqrt(larger(1.0 - (p * p + q * q), Floats(0.0)))
    sign = ti.select(n.z < 0.0, Floats(-1.0), one)
    a = -1.0 / (sign + n.z)
    b = n.x * n.y * a
    s = Triple(1.0 + sign * n.x * n.x * a, sign * b, -1.0 * sign * n.x)
    t = Triple(b, sign + n.y * n.y * a, -1.0 * n.y)
    return s * p + t * q + n * height, height

"""A rectangle of light for paths side by side: what rect.py does for one path, without images."""

import math

import taichi as ti

from tiscene.render import warp
from tiscene.render.intersect.wide import larger, smaller
from tiscene.render.lanes import (
    Bundle,
    Floats,
    Triple,
    along_axes,
    combined,
    dot,
    magnitude,
    triple_of,
    where,
)
from tiscene.render.lights.light_sample import axis
from tiscene.render.lights.rect import FAR, SMALL, area_pdf
from tiscene.scene.light_table import SIZE


@ti.func
def axes_of(values: ti.template(), row: ti.i32):
    """(x, y, z axis, centre) of the light."""
    return (
        triple_of(axis(values, row, 0)), triple_of(axis(values, row, 1)),
        triple_of(axis(values, row, 2)), triple_of(axis(values, row, 3)),
    )  # fmt: skip


@ti.func
def intersect(values: ti.template(), row: ti.i32, origin: ti.template(), direction: ti.template()):
    """Distance to the lit side, +inf for a miss."""
    x, y, z, centre = axes_of(values, row)
    cosine = dot(z, direction)
    offset = centre - origin
    height = dot(z, offset)
    distance = height / cosine
    q = direction * distance - offset
    met = where(cosine > 0.0) * where(height > 0.0)
    met *= where(magnitude(dot(x, q)) <= 0.5 * values[row, SIZE])
    met *= where(magnitude(dot(y, q)) <= 0.5 * values[row, SIZE + 1])
    return ti.select(met > 0.0, distance, Floats(ti.math.inf))


@ti.func
def sample(values: ti.template(), row: ti.i32, origin: ti.template(), u, v):
    """A direction from each origin to the light: a Bundle of direction, distance and pdf, 0 where it shines not."""
    x, y, z, centre = axes_of(values, row)
    middle = along_axes(x, y, z, centre - origin)
    half_width, half_height = 0.5 * values[row, SIZE], 0.5 * values[row, SIZE + 1]
    x0, x1, y0, y1, z0 = (
        middle.x - half_width, middle.x + half_width, middle.y - half_height, middle.y + half_height, middle.z
    )  # fmt: skip
    width, height, across, along = x1 - x0, y1 - y0, x0 + x1, y0 + y1
    near = where(width * width + height * height >= FAR * (across * across + along * along + 4.0 * z0 * z0))
    px, py, solid_angle = in_solid_angle(x0, x1, y0, y1, z0, u, v)
    near *= where(solid_angle > SMALL)
    px = ti.select(near > 0.0, px, x0 + u * width)
    py = ti.select(near > 0.0, py, y0 + v * height)
    distance = ti.sqrt(px * px + py * py + z0 * z0)
    offset = Triple(px, py, z0) * (1.0 / distance)
    by_area = area_pdf(values, row, offset.z, distance)
    pdf = ti.select(near > 0.0, 1.0 / solid_angle, by_area)
    return Bundle(
        direction=combined(x, y, z, offset), distance=distance, pdf=ti.select(z0 > 0.0, pdf, Floats(0.0))
    )  # fmt: skip


@ti.func
def rotation(sine):
    """As `warp.rotation`: (cosine, sine)."""
    return ti.sqrt(larger(1.0 - sine * sine, Floats(0.0))), sine


@ti.func
def turned_back(a: ti.template(), b: ti.template()):
    """As `warp.turned_back`."""
    return a[0] * b[0] + a[1] * b[1], a[1] * b[0] - a[0] * b[1]


@ti.func
def angle_of(cosine, sine):
    """As `warp.angle_of`."""
    half = sine / larger(1.0 + cosine, Floats(1e-30))
    steep = magnitude(half) > 1.0
    t = ti.select(steep, 1.0 / half, half)
    angle = t * warp.polynomial(warp.ARCTANGENT, t * t)
    beyond = ti.select(half > 0.0, Floats(0.5 * math.pi), Floats(-0.5 * math.pi)) - angle
    return 2.0 * ti.select(steep, beyond, angle)


@ti.func
def circle(turns):
    """As `warp.circle`, for 0..1."""
    aim = 4.0 * turns + 0.5
    first, second = where(aim >= 1.0), where(aim >= 2.0)
    third, fourth = where(aim >= 3.0), where(aim >= 4.0)
    rest = turns - 0.25 * (first + second + third + fourth)
    squared = rest * rest
    cosine, sine = warp.polynomial(warp.COSINE, squared), rest * warp.polynomial(warp.SINE, squared)
    odd = first - second + third - fourth > 0.0
    sign = ti.select(second - fourth > 0.0, Floats(-1.0), Floats(1.0))
    return sign * ti.select(odd, 0.0 - sine, cosine), sign * ti.select(odd, cosine, sine)


@ti.func
def in_solid_angle(x0, x1, y0, y1, z0, u, v):
    """(x, y, solid angle) of a point by `warp.rectangle_view` and `warp.rectangle`."""
    zz = z0 * z0
    a0, a1 = x0 / ti.sqrt(x0 * x0 + zz), x1 / ti.sqrt(x1 * x1 + zz)
    b0, b1 = y0 / ti.sqrt(y0 * y0 + zz), y1 / ti.sqrt(y1 * y1 + zz)
    first = turned_back(rotation(a0 * b1), rotation(a0 * b0))
    whole = turned_back(turned_back(rotation(a1 * b1), rotation(a1 * b0)), first)
    solid_angle = angle_of(whole[0], whole[1])
    past_half = where(whole[0] < 0.0) + where(solid_angle < -1e-3)
    mended = ti.select(past_half > 0.0, solid_angle + 2.0 * math.pi, Floats(0.0))
    solid_angle = ti.select(solid_angle < 0.0, mended, solid_angle)
    cosine, sine = circle(u * solid_angle * warp.INV_TWO_PI)
    turned = cosine * first[0] - sine * first[1]
    sine = cosine * first[1] + sine * first[0]
    sine = ti.select(magnitude(sine) < 1e-12, Floats(1e-12), sine)
    f = (b1 - b0 * turned) / sine
    x = magnitude(z0) / ti.sqrt(larger(f * f + b0 * b0 - 1.0, Floats(1e-14)))
    x = larger(x0, smaller(x1, ti.select(f > 0.0, x, 0.0 - x)))
    dd = x * x + zz
    h0, h1 = y0 / ti.sqrt(dd + y0 * y0), y1 / ti.sqrt(dd + y1 * y1)
    h = h0 + v * (h1 - h0)
    y = h * ti.sqrt(dd / larger(1.0 - h * h, Floats(1e-14)))
    return x, larger(y0, smaller(y1, y)), solid_angle

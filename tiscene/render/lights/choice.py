"""Which light to sample: in proportion to what each would give at a point if nothing stood in between.

Light from infinity counts only where it can come in: in a room with portals, a sun that shines through none of them is
hardly ever chosen. Scenes with more than FEW lights choose by power alone.
"""

import taichi as ti

from tiscene.render.lights import portals, shaping
from tiscene.render.lights.light_sample import axis
from tiscene.scene.light_table import CHANCE, CUMULATIVE, DISK, DISTANT, DOME, KIND, SHAPED, SIZE, STRENGTH

vec3 = ti.math.vec3

FEW = 16
# This part of the choices is even, for what the estimate does not know of.
EVEN_PART = 0.1


@ti.func
def arriving(lights: ti.template(), row: ti.i32, origin: vec3) -> ti.f32:
    """About the irradiance, W/m² by luminance, of the light of that row on a surface at `origin` that faces it."""
    values = ti.static(lights.values)
    kind = ti.cast(values[row, KIND], ti.i32)
    result = values[row, STRENGTH]
    if kind < DISTANT:
        offset = origin - axis(values, row, 3)
        size = ti.max(values[row, SIZE], values[row, SIZE + 1])
        distance2 = offset.dot(offset) + 0.25 * size * size
        facing = 1.0
        if kind <= DISK:
            facing = ti.max(-offset.dot(axis(values, row, 2)) / ti.sqrt(distance2), 0.0)
        result *= facing / distance2
        if values[row, SHAPED] > 0.0:
            result *= shaping.in_cone(values, row, -offset.dot(axis(values, row, 2)) / ti.sqrt(distance2))
    else:
        if kind == DOME:
            result *= portals.openness(values, row, origin)
        elif portals.shines(values, row, origin) == 0:
            result = 0.0
    return result


@ti.func
def total_arriving(lights: ti.template(), origin: vec3) -> ti.f32:
    """Of all lights."""
    result = 0.0
    for row in range(lights.total):
        result += arriving(lights, row, origin)
    return result


@ti.func
def mixed(lights: ti.template(), part: ti.f32, total: ti.f32) -> ti.f32:
    """The chance of a light that gives `part` of what arrives."""
    even = 1.0 / lights.total
    result = even
    if total > 0.0:
        result = EVEN_PART * even + (1.0 - EVEN_PART) * part / total
    return result


@ti.func
def choose(lights: ti.template(), origin: vec3, u: ti.f32):
    """(row, its chance) of the light to sample from a point."""
    chosen = 0
    chance = 1.0
    if lights.total > FEW:
        chosen = by_power(lights, u)
        chance = lights.values[chosen, CHANCE]
    elif lights.total > 1:
        even = u < EVEN_PART
        chosen = ti.min(ti.cast(u * (lights.total / EVEN_PART), ti.i32), lights.total - 1)
        rest = (u - EVEN_PART) * (1.0 / (1.0 - EVEN_PART))
        part, total = 0.0, 0.0
        # One pass: each light takes the place of those before it by its share of what they give together.
        for row in range(lights.total):
            here = arriving(lights, row, origin)
            total += here
            if even:
                if row == chosen:
                    part = here
            elif here > 0.0:
                share = here / total
                if rest < share:
                    chosen, part = row, here
                    rest /= share
                else:
                    rest = (rest - share) / (1.0 - share)
        if total <= 0.0:
            chosen = ti.min(ti.cast(u * lights.total, ti.i32), lights.total - 1)
        chance = mixed(lights, part, total)
    return chosen, chance


@ti.func
def chance_of(lights: ti.template(), row: ti.i32, origin: vec3) -> ti.f32:
    """The chance with which `choose` picks the row."""
    result = lights.values[row, CHANCE]
    if lights.total > 1 and lights.total <= FEW:
        result = mixed(lights, arriving(lights, row, origin), total_arriving(lights, origin))
    return result


@ti.func
def by_power(lights: ti.template(), u: ti.f32) -> ti.i32:
    """A row by its power, by bisection."""
    low, high = 0, lights.total
    while high - low > 1:
        middle = (low + high) // 2
        if lights.values[middle - 1, CUMULATIVE] <= u:
            low = middle
        else:
            high = middle
    return low

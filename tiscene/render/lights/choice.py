"""Which light to sample: in proportion to what each would give at a point if nothing stood in between.

Light from infinity counts only where it can come in: in a room with portals, a sun that shines through none of them is
hardly ever chosen. Many lights are in groups: first a group is chosen, by what it would give from its middle, then one
of its lights; that takes about twice the root of their number instead of all of them.
"""

import taichi as ti

from tiscene.render.lights import portals, shaping
from tiscene.render.lights.light_sample import axis
from tiscene.scene.light_table import (
    DISK,
    DISTANT,
    DOME,
    G_COUNT,
    G_FIRST,
    G_MIDDLE,
    G_SIZE2,
    G_STRENGTH,
    GROUP,
    GROUP_COLUMNS,
    GROUP_COUNT,
    GROUPS,
    KIND,
    SHAPED,
    SIZE,
    STRENGTH,
)

vec3 = ti.math.vec3

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
def start_of(lights: ti.template(), group: ti.i32) -> ti.i32:
    """Where a group is in `distribution`."""
    return ti.cast(lights.values[0, GROUPS], ti.i32) + group * GROUP_COLUMNS


@ti.func
def member(lights: ti.template(), group: ti.i32, number: ti.i32) -> ti.i32:
    """The row of a light of a group."""
    first = ti.cast(lights.distribution[start_of(lights, group) + G_FIRST], ti.i32)
    return ti.cast(lights.distribution[first + number], ti.i32)


@ti.func
def size_of(lights: ti.template(), group: ti.i32) -> ti.i32:
    """How many lights a group has."""
    return ti.cast(lights.distribution[start_of(lights, group) + G_COUNT], ti.i32)


@ti.func
def arriving_from_group(lights: ti.template(), group: ti.i32, origin: vec3) -> ti.f32:
    """About what the lights of a group give together."""
    table = ti.static(lights.distribution)
    at = start_of(lights, group)
    result = 0.0
    if table[at + G_SIZE2] < 0.0:
        for number in range(size_of(lights, group)):
            result += arriving(lights, member(lights, group, number), origin)
    else:
        offset = origin - vec3(table[at + G_MIDDLE], table[at + G_MIDDLE + 1], table[at + G_MIDDLE + 2])
        result = table[at + G_STRENGTH] / (offset.dot(offset) + table[at + G_SIZE2] + 1e-6)
    return result


@ti.func
def choose(lights: ti.template(), origin: vec3, u: ti.f32):
    """(row, its chance) of the light to sample from a point."""
    chosen = 0
    chance = 1.0
    if lights.total > 1:
        even = u < EVEN_PART
        chosen = ti.min(ti.cast(u * (lights.total / EVEN_PART), ti.i32), lights.total - 1)
        rest = (u - EVEN_PART) * (1.0 / (1.0 - EVEN_PART))
        group, group_chance = 0, 1.0
        groups = ti.cast(lights.values[0, GROUP_COUNT], ti.i32)
        if groups > 1:
            if even:
                group = ti.cast(lights.values[chosen, GROUP], ti.i32)
            own, total = 0.0, 0.0
            # One pass: each takes the place of those before it by its share of what they give together.
            for candidate in range(groups):
                here = arriving_from_group(lights, candidate, origin)
                total += here
                if even:
                    if candidate == group:
                        own = here
                elif here > 0.0:
                    share = here / total
                    if rest < share:
                        group, own = candidate, here
                        rest /= share
                    else:
                        rest = (rest - share) / (1.0 - share)
            group_chance = own / total if total > 0.0 else 0.0
            rest = ti.min(rest, 0.99999994)
        count = size_of(lights, group)
        if not even:
            chosen = member(lights, group, ti.min(ti.cast(rest * count, ti.i32), count - 1))
        part, whole = 0.0, 0.0
        for number in range(count):
            row = member(lights, group, number)
            here = arriving(lights, row, origin)
            whole += here
            if even:
                if row == chosen:
                    part = here
            elif here > 0.0:
                share = here / whole
                if rest < share:
                    chosen, part = row, here
                    rest /= share
                else:
                    rest = (rest - share) / (1.0 - share)
        within = part / whole if whole > 0.0 else 1.0 / count
        chance = EVEN_PART / lights.total + (1.0 - EVEN_PART) * group_chance * within
    return chosen, chance


@ti.func
def chance_of(lights: ti.template(), row: ti.i32, origin: vec3) -> ti.f32:
    """The chance with which `choose` picks the row."""
    chance = 1.0
    if lights.total > 1:
        group, group_chance = ti.cast(lights.values[row, GROUP], ti.i32), 1.0
        groups = ti.cast(lights.values[0, GROUP_COUNT], ti.i32)
        if groups > 1:
            own, total = 0.0, 0.0
            for candidate in range(groups):
                here = arriving_from_group(lights, candidate, origin)
                total += here
                if candidate == group:
                    own = here
            group_chance = own / total if total > 0.0 else 0.0
        count = size_of(lights, group)
        part, whole = 0.0, 0.0
        for number in range(count):
            other = member(lights, group, number)
            here = arriving(lights, other, origin)
            whole += here
            if other == row:
                part = here
        within = part / whole if whole > 0.0 else 1.0 / count
        chance = EVEN_PART / lights.total + (1.0 - EVEN_PART) * group_chance * within
    return chance

"""A dome's portals: rectangles that its light comes in by, chosen by about the solid angle that they fill.

A portal is a row of the light table after those of the lights, read as a RectLight's is; light passes along its -z.
Where a direction crosses several portals, each of them could have led to it, and their densities add up.
"""

import math

import taichi as ti

from tiscene.render.lights import rect
from tiscene.render.lights.light_sample import axis
from tiscene.scene.light_table import PORTAL_COUNT, PORTALS, SIZE

vec2 = ti.math.vec2
vec3 = ti.math.vec3


# A sun shines through a portal up to this part of its size beyond its edges, for it has an edge itself.
_MARGIN = 0.05


@ti.func
def rows_of(values: ti.template(), dome: ti.i32):
    """(first, end) of the rows of the portals of a dome, or of all domes for a distant light."""
    first = ti.cast(values[dome, PORTALS], ti.i32)
    return first, first + ti.cast(values[dome, PORTAL_COUNT], ti.i32)


@ti.func
def weight(values: ti.template(), portal: ti.i32, origin: vec3) -> ti.f32:
    """About the solid angle of a portal, sr; 0 for who is on its other side."""
    result = 0.0
    offset = axis(values, portal, 3) - origin
    height = offset.dot(axis(values, portal, 2))
    if height > 0.0:
        area = values[portal, SIZE] * values[portal, SIZE + 1]
        distance2 = offset.dot(offset)
        result = area * height / ((distance2 + area * (0.5 / math.pi)) * ti.sqrt(distance2))
    return result


@ti.func
def choose(values: ti.template(), dome: ti.i32, origin: vec3, u: ti.f32):
    """One of a dome's portals by its weight: (row, that weight, all their weights, what is left of u).

    Row -1: none is open to that point, and the dome is as one without portals.
    """
    first, end = rows_of(values, dome)
    chosen, own, total, rest = -1, 0.0, 0.0, u
    for portal in range(first, end):
        here = weight(values, portal, origin)
        if here > 0.0:
            total += here
            chance = here / total
            if rest < chance:  # always true of the first
                chosen, own = portal, here
                rest /= chance
            else:
                rest = (rest - chance) / (1.0 - chance)
    return chosen, own, total, ti.min(rest, 0.99999994)


@ti.func
def density(lights: ti.template(), dome: ti.i32, origin: vec3, direction: vec3, but: ti.i32) -> ti.f32:
    """The density, times all portals' weights, with which `choose` and sampling what it chose lead to a direction,
    leaving out portal `but`."""
    first, end = rows_of(lights.values, dome)
    result = 0.0
    for portal in range(first, end):
        if portal != but:
            distance = rect.intersect(lights, portal, origin, direction)
            if distance < ti.math.inf:
                here = weight(lights.values, portal, origin)
                result += here * rect.pdf(lights, portal, origin, direction, distance)
    return result


@ti.func
def openness(values: ti.template(), dome: ti.i32, origin: vec3) -> ti.f32:
    """The sum of the portals' weights, at most that of a hemisphere's cosines; so much too where there are none."""
    first, end = rows_of(values, dome)
    result = 0.0
    for portal in range(first, end):
        result += weight(values, portal, origin)
    return ti.min(result, math.pi) if result > 0.0 else math.pi


@ti.func
def shines(values: ti.template(), light: ti.i32, origin: vec3) -> ti.i32:
    """1 where a distant light's -z axis leads to the point through a portal, or no portal faces the point; else 0."""
    first, end = rows_of(values, light)
    towards = axis(values, light, 2)
    result, faces = 0, 0
    for portal in range(first, end):
        offset = axis(values, portal, 3) - origin
        normal = axis(values, portal, 2)
        height = offset.dot(normal)
        if height > 0.0:
            faces = 1
            climb = towards.dot(normal)
            if climb > 0.0:
                miss = towards * (height / climb) - offset
                across, along = miss.dot(axis(values, portal, 0)), miss.dot(axis(values, portal, 1))
                reach = 0.5 + _MARGIN
                if ti.abs(across) <= reach * values[portal, SIZE] and ti.abs(along) <= reach * values[portal, SIZE + 1]:
                    result = 1
    return ti.max(result, 1 - faces)

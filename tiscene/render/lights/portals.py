"""A dome's portals: rectangles that its light comes in by, sampled uniformly in the solid angle that they fill.

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
def choose(values: ti.template(), dome: ti.i32, origin: vec3, u: ti.f32):
    """One of a dome's portals by the solid angle that it fills: (row, solid angle of all, what is left of u).

    A portal fills none for who is on its other side. Row -1: none does, and the dome is as one without portals.
    """
    first, end = rows_of(values, dome)
    chosen, total, rest = -1, 0.0, u
    for portal in range(first, end):
        view = rect.view_from(values, portal, origin)
        if view.z0 > 0.0 and view.solid_angle > 0.0:
            total += view.solid_angle
            chance = view.solid_angle / total
            if rest < chance:  # always true of the first
                chosen = portal
                rest /= chance
            else:
                rest = (rest - chance) / (1.0 - chance)
    return chosen, total, ti.min(rest, 0.99999994)


@ti.func
def crossed(lights: ti.template(), dome: ti.i32, origin: vec3, direction: vec3, but: ti.i32) -> ti.f32:
    """How many of a dome's portals, leaving out row `but`, a direction crosses.

    That is the density of `choose` and then sampling, times all their solid angle. (One so small that it is sampled by
    its area counts a little more or less than 1, as its density does.)
    """
    first, end = rows_of(lights.values, dome)
    result = 0.0
    for portal in range(first, end):
        if portal != but:
            distance = rect.intersect(lights, portal, origin, direction)
            if distance < ti.math.inf:
                view = rect.view_from(lights.values, portal, origin)
                result += view.solid_angle * rect.pdf_in(view, lights.values, portal, direction, distance)
    return result


@ti.func
def openness(values: ti.template(), light: ti.i32, origin: vec3):
    """How a point is open to light from infinity: (about the solid angle of the portals, whether the light's -z axis
    leads through one of them to the point). Where no portal faces the point: (pi, True), as in the open.
    """
    first, end = rows_of(values, light)
    towards = axis(values, light, 2)
    solid_angle = 0.0
    faces, shines = False, False
    for portal in range(first, end):
        offset = axis(values, portal, 3) - origin
        normal = axis(values, portal, 2)
        height = offset.dot(normal)
        if height > 0.0:
            faces = True
            width, length = values[portal, SIZE], values[portal, SIZE + 1]
            distance2 = offset.dot(offset)
            solid_angle += width * length / (distance2 + width * length / (2.0 * math.pi)) * height / ti.sqrt(distance2)
            climb = towards.dot(normal)
            if climb > 0.0:
                miss = towards * (height / climb) - offset
                across, along = miss.dot(axis(values, portal, 0)), miss.dot(axis(values, portal, 1))
                reach = 0.5 + _MARGIN
                if ti.abs(across) <= reach * width and ti.abs(along) <= reach * length:
                    shines = True
    if not faces:
        solid_angle, shines = math.pi, True
    return solid_angle, shines

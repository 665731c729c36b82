# SPDX-License-Identifier: Apache-2.0
"""What every kind of light answers, and how a row of the light table is read."""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec3
from tiscene.scene.lights.light_table import RADIANCE, TRANSFORM
from tiscene.scene.lights.light_tree import LANE_BITS, LANES, ROW, ROWS

FAR = 1e30  # stands for infinity where a ray has to have an end


class LightTables(NamedTuple):
    """The arrays of a LightTable, bundled inside a kernel; with the Geometry and Materials where meshes are sampled."""

    values: Any
    nodes: Any
    distribution: Any
    geometry: Any = None
    materials: Any = None

    @property
    def with_meshes(self) -> bool:
        """Whether meshes are sampled."""
        return self.geometry is not None


def lights_of(values: Any, nodes: Any, distribution: Any, geometry: Any, materials: Any, meshes: bool) -> LightTables:
    """LightTables with meshes or without: where no surface emits, the code for them is left out."""
    return LightTables(values, nodes, distribution, *((geometry, materials) if meshes else ()))


@ti.dataclass
class LightSample:
    """A direction towards a light. pdf: per steradian, 0 for no sample; for a delta light 1, and delta is 1.

    mis_pdf: the same, were the light chosen for a surface that faces every light: what weights of multiple importance
    sampling are made of, since who runs into a light does not know the normal that he came from.
    """

    direction: vec3
    distance: ti.f32
    radiance: vec3  # for a delta light: irradiance on a surface that faces it
    pdf: ti.f32
    mis_pdf: ti.f32
    delta: ti.i32
    row: ti.i32  # of the light; of a portal that of its dome


@ti.func
def no_sample():
    """Nothing of the light is seen from there."""
    ahead = vec3(0.0, 0.0, 1.0)
    return LightSample(direction=ahead, distance=0.0, radiance=vec3(0.0), pdf=0.0, mis_pdf=0.0, delta=0, row=0)


@ti.func
def integer(array: Template, row: ti.i32, column: Template) -> ti.i32:
    """A whole number among floats."""
    return ti.cast(array[row, column], ti.i32)


@ti.func
def attribute(nodes: Template, node: ti.i32, which: Template) -> float8:
    """One attribute of all members of a node of lights."""
    return nodes[ROWS * node + which]


@ti.func
def of_member(nodes: Template, place: ti.i32, which: Template) -> ti.f32:
    """One attribute of a member."""
    return nodes[ROWS * (place >> LANE_BITS) + which][place & (LANES - 1)]


@ti.func
def row_at(nodes: Template, place: ti.i32) -> ti.i32:
    """The light of a member."""
    return ti.cast(of_member(nodes, place, ROW), ti.i32)


@ti.func
def of_node(nodes: Template, node: ti.i32, column: Template) -> ti.f32:
    """What a node knows of itself; of the header any column."""
    return nodes[ROWS * node + column // LANES][column % LANES]


@ti.func
def header(nodes: Template, column: Template) -> ti.i32:
    """A whole number of the header."""
    return ti.cast(of_node(nodes, 0, column), ti.i32)


@ti.func
def color(values: Template, row: ti.i32) -> vec3:
    """The radiance before any texture (a point's intensity; a delta distant light's irradiance)."""
    return vec3(values[row, RADIANCE], values[row, RADIANCE + 1], values[row, RADIANCE + 2])


@ti.func
def axis(values: Template, row: ti.i32, column: ti.i32) -> vec3:
    """A column of world_from_light: 0, 1, 2 for its x, y, z axes, unit; 3 for its position."""
    at = TRANSFORM + column
    return vec3(values[row, at], values[row, at + 4], values[row, at + 8])


@ti.func
def from_light(values: Template, row: ti.i32, w: vec3) -> vec3:
    """A direction in the light's axes, in the world."""
    return axis(values, row, 0) * w.x + axis(values, row, 1) * w.y + axis(values, row, 2) * w.z


@ti.func
def to_light(values: Template, row: ti.i32, w: vec3) -> vec3:
    """A world direction in the light's axes."""
    return vec3(axis(values, row, 0).dot(w), axis(values, row, 1).dot(w), axis(values, row, 2).dot(w))

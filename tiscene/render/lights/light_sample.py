# SPDX-License-Identifier: Apache-2.0
"""LightSample, the result of sampling a light, and access to rows of the light table and nodes of the light tree."""

from typing import Any, NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Template, float8, vec3
from tiscene.render.columns import read3
from tiscene.scene.lights.light_table import LIT, RADIANCE, TRANSFORM
from tiscene.scene.lights.light_tree import LANE_BITS, LANES, ROW, ROWS

FAR = 1e30  # finite stand-in for the distance to lights at infinity, m


class LightTables(NamedTuple):
    """The arrays of a LightTable, bundled inside a kernel.

    Attributes:
        geometry, materials: None if no emissive mesh is sampled.
        with_links: Whether a light has light or shadow linking.
    """

    values: Any
    nodes: Any
    distribution: Any
    geometry: Any = None
    materials: Any = None
    with_links: bool = False

    @property
    def with_meshes(self) -> bool:
        """Whether emissive meshes are sampled."""
        return self.geometry is not None


def lights_of(
    values: Any, nodes: Any, distribution: Any, geometry: Any, materials: Any, meshes: bool, links: bool = False
) -> LightTables:
    """Bundle the arrays. Without `meshes`, no code for emissive meshes is compiled; without `links`, none for links."""
    return LightTables(values, nodes, distribution, *((geometry, materials) if meshes else (None, None)), links)


@ti.dataclass
class LightSample:
    """A sampled direction towards a light.

    MIS weights use `mis_pdf`, since a BSDF-sampled hit does not know the previous vertex's normal.
    """

    direction: vec3  # unit, from the shading point
    distance: ti.f32  # m
    radiance: vec3  # of a delta light: irradiance on a surface that faces it
    pdf: ti.f32  # 1/sr; 0: no sample; 1 for a delta light
    mis_pdf: ti.f32  # 1/sr; the density if the light were chosen for a surface that faces every light
    delta: ti.i32  # 1 for a light without extent
    row: ti.i32  # of the light; of a portal, its dome's
    height: vec3  # of a mesh: along the normal; a ray that ends this high above either side does not hit it, m


@ti.func
def no_sample():
    """Return a sample with density 0: no part of the light is visible from the shading point."""
    ahead = vec3(0.0, 0.0, 1.0)
    return LightSample(
        direction=ahead, distance=0.0, radiance=vec3(0.0), pdf=0.0, mis_pdf=0.0, delta=0, row=0, height=vec3(0.0)
    )  # fmt: skip


@ti.func
def integer(array: Template, row: ti.i32, column: Template) -> ti.i32:
    """Return a column of a float table as an integer."""
    return ti.cast(array[row, column], ti.i32)


@ti.func
def is_linked(lights: Template, row: ti.i32, link_class: ti.i32):
    """Return 1 if the light in a row lights the meshes of a link class, else 0."""
    table = integer(lights.values, row, LIT)
    result = 1
    if table >= 0:
        result = ti.cast(lights.distribution[table + link_class], ti.i32)
    return result


@ti.func
def node_lanes(nodes: Template, node: ti.i32, attribute: Template) -> float8:
    """Return one attribute of all children of a node."""
    return nodes[ROWS * node + attribute]


@ti.func
def slot_value(nodes: Template, slot: ti.i32, attribute: Template) -> ti.f32:
    """Return one attribute of the child in a slot."""
    return nodes[ROWS * (slot >> LANE_BITS) + attribute][slot & (LANES - 1)]


@ti.func
def light_row(nodes: Template, slot: ti.i32) -> ti.i32:
    """Return the light-table row of the child in a slot."""
    return ti.cast(slot_value(nodes, slot, ROW), ti.i32)


@ti.func
def node_value(nodes: Template, node: ti.i32, column: Template) -> ti.f32:
    """Return an attribute of a node itself, or a column of the header."""
    return nodes[ROWS * node + column // LANES][column % LANES]


@ti.func
def header(nodes: Template, column: Template) -> ti.i32:
    """Return a column of the header as an integer."""
    return ti.cast(node_value(nodes, 0, column), ti.i32)


@ti.func
def color(values: Template, row: ti.i32) -> vec3:
    """Return the radiance before any texture; a point's intensity; a parallel distant light's irradiance."""
    return read3(values, row, RADIANCE)


@ti.func
def axis(values: Template, row: ti.i32, column: ti.i32) -> vec3:
    """Return a column of world_from_light: 0, 1, 2 for the unit x, y, z axes; 3 for the position, m."""
    at = TRANSFORM + column
    return vec3(values[row, at], values[row, at + 4], values[row, at + 8])


@ti.func
def from_light(values: Template, row: ti.i32, w: vec3) -> vec3:
    """Transform a direction from light space to world space."""
    return axis(values, row, 0) * w.x + axis(values, row, 1) * w.y + axis(values, row, 2) * w.z


@ti.func
def to_light(values: Template, row: ti.i32, w: vec3) -> vec3:
    """Transform a direction from world space to light space."""
    return vec3(axis(values, row, 0).dot(w), axis(values, row, 1).dot(w), axis(values, row, 2).dot(w))

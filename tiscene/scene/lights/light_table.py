# SPDX-License-Identifier: Apache-2.0
"""All lights of a scene: a row each, the nodes that they are chosen by, and the distributions of their images."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload, upload_vectors
from tiscene.scene.description import (
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    Light,
    Portal,
    RectLight,
    Shaping,
    SphereLight,
)
from tiscene.scene.lights import light_bvh, light_tree
from tiscene.scene.lights.image_distribution import (
    LUMINANCE,
    dome_distribution,
    image_part,
    lamp_distribution,
    mean_luminance,
    small_copy,
    sun_part,
)
from tiscene.scene.lights.light_groups import shine
from tiscene.scene.lights.light_tree import (
    BACK,
    CENTRE,
    CONE,
    FAR2,
    H_BOXES,
    H_CHOICE,
    H_DISTANT_ROW,
    H_DOME_ROW,
    H_END,
    H_PORTAL_ROW,
    H_ROWS,
    H_SOLID_COUNT,
    LANES,
    NORMAL,
    ROUND,
    ROW,
    ROWS,
    SIZE2,
    STRENGTH,
)
from tiscene.scene.lights.mesh_lights import MeshLight
from tiscene.scene.textures.atlas import TextureAtlas

# Kinds of light, in the order of the rows: what a ray can meet comes first. A portal is sampled as a light of its own.
RECT, DISK, SPHERE, CYLINDER, POINT, DISTANT, DOME, PORTAL, MESH = range(9)
LAST_SOLID = CYLINDER

# Columns of `values`. TRANSFORM: world_from_light, 3x4 row-major. SIZE: rect and portal width and height; disk and
# sphere radius; cylinder radius and length; distant: cosine of half the angle, 1 - that cosine. TEXTURE: row of the
# atlas or -1. DISTRIBUTION, GRID: where an image's begins, its columns and rows. IMAGE_PART: how many of the samples of
# a rect are drawn from its image. NODE: its place among the nodes. DOME_ROW: of a portal. SHADES: where in
# `distribution` begins by which portals a distant light comes in, see `_shades`, or -1 without portals. SMALL_COPY:
# where there a dome's begins, see `small_copy`, or -1. Of an instance that gives light INSTANCE is its row, TREE the
# node where that of its mesh's triangles begins; FIRST_TRIANGLE: of the mesh, for which at DISTRIBUTION each triangle's
# place follows, 0 for none. ON_DIFFUSE, ON_SPECULAR: multipliers of the response; ON_INDIRECT: after a bounce.
# SHADOWLESS: 1 where nothing keeps its light off anything. SHAPED: 1 where a light has a Shaping. CONE_COSINE: of its
# cone's angle; CONE_EDGE: the angles at which the soft edge begins and ends, and the cosine where it begins;
# FOCUS_TINT, PROFILE as TEXTURE.
COLUMNS = 39
KIND, TRANSFORM, RADIANCE, SIZE, TEXTURE, DISTRIBUTION, GRID, IMAGE_PART = 0, 1, 13, 16, 18, 19, 20, 22
NODE, DOME_ROW, SHADES, SMALL_COPY, ON_DIFFUSE, ON_SPECULAR, SHADOWLESS = 23, 24, 24, 24, 25, 26, 27
INSTANCE, TREE, FIRST_TRIANGLE = 13, 14, 15
SHAPED, CONE_COSINE, CONE_EDGE, FOCUS, FOCUS_TINT, PROFILE = 28, 29, 30, 33, 34, 37
ON_INDIRECT = 38

# A box is wider than its light by this part of its coordinates: they are rounded.
_ROUNDING = 1e-6
# The light through a portal's frame counts a little beyond it, for rounding and the width of the sun.
_MARGIN = 0.05
SHADE_COLUMNS = 8


class LightArrays(NamedTuple):
    """values: f32 [n + portals, 39], columns as named above; nodes: [m] of 8, see `light_nodes` and `light_boxes`;
    distribution: f32 [k], see `dome_distribution`."""

    values: Any
    nodes: Any
    distribution: Any


def kind_of(light: Light) -> int:
    """The kind, one of the constants above."""
    match light:
        case RectLight():
            return RECT
        case DiskLight():
            return DISK
        case SphereLight():
            return SPHERE if light.radius > 0.0 else POINT
        case CylinderLight():
            return CYLINDER
        case DistantLight():
            return DISTANT
        case DomeLight():
            return DOME
    raise TypeError(f"{light.prim_path}: no kind of light for {type(light).__name__}")


def _shaping_columns(shaping: Shaping, first_texture: int) -> list[float]:
    """From SHAPED to PROFILE."""
    inner, outer = (1.0 - shaping.cone_softness) * shaping.cone_angle, shaping.cone_angle
    # A cone of half a turn or more leaves nothing out, and rounding must not.
    whole = outer >= math.pi
    cosines = (-2.0, -2.0) if whole else (math.cos(outer), math.cos(inner))
    profile = -1 if shaping.profile is None else first_texture + shaping.profile
    return [1.0, cosines[0], inner, outer, cosines[1], shaping.focus, *shaping.focus_tint, profile]


def _shades(towards: NDArray[np.float64], portals: Sequence[Portal]) -> NDArray[np.float64]:
    """Of each portal, two affine maps of a point, [n, 8]: how far beside the portal's middle, across and along, the
    line from the point along `towards` passes; from -1 to 1 within the frame."""
    result = np.full((len(portals), SHADE_COLUMNS), 2.0)
    result[:, [0, 1, 2, 4, 5, 6]] = 0.0
    for row, portal in zip(result, portals, strict=True):
        x, y, z, place = portal.world_from_portal[:3].T
        climb = float(towards @ z)
        if climb > 0.0:
            for side, axis, size in ((0, x, portal.width), (4, y, portal.height)):
                # Of p + towards * ((place - p) . z / climb) - place along the axis.
                slope = (axis - z * (towards @ axis) / climb) / ((0.5 + _MARGIN) * size)
                row[side : side + 4] = *slope, -slope @ place
    return result


class _Row(NamedTuple):
    """What a row and its node are made of: strength about as a node's, flat or round, size as a node's SIZE2; how far
    the light reaches along its axes, as the sum of a box and an ellipsoid."""

    sizes: tuple[float, ...]
    strength: float
    flat: bool
    size2: float
    straight: tuple[float, float, float]
    rounded: tuple[float, float, float]


def _lamp(light: Light, brightness: float) -> _Row:
    """Of a light that has a place."""
    nothing = (0.0, 0.0, 0.0)
    match light:
        case RectLight(width=width, height=height):
            area = width * height
            reach = (0.5 * width, 0.5 * height, 0.0)
            return _Row((width, height), area * brightness, True, area / (2.0 * math.pi), reach, nothing)
        case DiskLight(radius=radius):
            strength = math.pi * radius**2 * brightness
            return _Row((radius,), strength, True, 0.5 * radius**2, nothing, (radius, radius, 0.0))
        case SphereLight(radius=0.0):
            return _Row((0.0,), brightness, False, 0.0, nothing, nothing)
        case SphereLight(radius=radius):
            strength = math.pi * radius**2 * brightness
            return _Row((radius,), strength, False, 0.25 * radius**2, nothing, (radius, radius, radius))
        case CylinderLight(radius=radius, length=length):
            size2 = 0.25 * max(radius, length) ** 2
            reach = (0.5 * length, 0.0, 0.0)
            return _Row(
                (radius, length), 2.0 * radius * length * brightness, False, size2, reach, (0.0, radius, radius)
            )
    raise TypeError(type(light).__name__)


def _box(light: Light, lamp: _Row) -> NDArray[np.float64]:
    """[2, 3]: the least and the largest coordinates of what a ray can meet of a light."""
    matrix = light.world_from_light[:3]
    reach = np.abs(matrix[:, :3]) @ lamp.straight + np.sqrt(matrix[:, :3] ** 2 @ np.square(lamp.rounded))
    reach += _ROUNDING * (np.abs(matrix[:, 3]) + reach)
    return np.array([matrix[:, 3] - reach, matrix[:, 3] + reach])


class LightTable:
    """Grows by `append`; the device arrays are made anew when the lights change."""

    def __init__(self) -> None:
        self.lights: list[Light] = []
        self._first_texture: list[int] = []
        self._meshes: list[tuple[int, MeshLight, int]] = []  # row of the instance, its mesh, that one's first triangle
        self._places: NDArray[np.float64] = np.zeros((0, 3, 4))
        self._arrays: LightArrays | None = None
        # Of images, by row of the atlas: of domes the distribution, its grid and the sun's part; of lamps the
        # distribution, its grid and the image's part; the mean luminance.
        self._skies: dict[int, tuple[NDArray[np.float32], tuple[int, int], float]] = {}
        self._copies: dict[int, NDArray[np.float32] | None] = {}
        self._panels: dict[int, tuple[NDArray[np.float32], tuple[int, int], float]] = {}
        self._means: dict[int, float] = {}
        # What is on the device as LightArrays.distribution: a lamp that moves leaves it as it is.
        self._distributions: list[NDArray[np.float32]] = []
        self._uploaded: Any = None

    def __len__(self) -> int:
        return len(self.lights)

    def append(self, lights: Iterable[Light], first_texture: int) -> int:
        """Add lights whose textures begin at a row of the atlas. Returns how many there were before."""
        before = len(self.lights)
        self.lights.extend(lights)
        self._first_texture += [first_texture] * (len(self.lights) - before)
        self._arrays = None
        return before

    def place(self, lights: Sequence[Light], first_textures: Sequence[int]) -> None:
        """These are the lights from now on, in the place of all that were there; cheap where they are the same ones.

        first_textures: for each, the row of the atlas where its description's textures begin.
        """
        same = len(lights) == len(self.lights) and all(a is b for a, b in zip(lights, self.lights, strict=True))
        if not same:
            self.lights, self._first_texture = list(lights), list(first_textures)
            self._arrays = None

    def place_meshes(self, meshes: Sequence[tuple[int, MeshLight, int]], places: NDArray[np.float64]) -> None:
        """These instances give light from now on: (row of the instance, its mesh, that one's first triangle), by row.

        places: [n, 3, 4], world_from_object.
        """
        if list(meshes) != self._meshes or not np.array_equal(places, self._places):
            self._meshes, self._places = list(meshes), places.copy()
            self._arrays = None

    def arrays(self, atlas: TextureAtlas) -> LightArrays:
        """What kernels read."""
        if self._arrays is None:
            self._arrays = self._build(atlas)
        return self._arrays

    def rows(self) -> NDArray[np.int64]:
        """Where in `LightArrays.values` each of `lights` is."""
        return np.argsort(np.array(self._order(), np.int64))

    def _order(self) -> list[int]:
        return sorted(range(len(self.lights)), key=lambda row: kind_of(self.lights[row]))

    def _build(self, atlas: TextureAtlas) -> LightArrays:
        order = self._order()
        lights = [self.lights[row] for row in order]
        kinds = [kind_of(light) for light in lights]
        domes = [(row, light) for row, light in enumerate(lights) if isinstance(light, DomeLight)]
        portals = [(row, portal) for row, dome in domes for portal in dome.portals]
        first_mesh = len(lights) + len(portals)
        values = np.zeros((first_mesh + len(self._meshes), COLUMNS), np.float32)
        leaves = light_tree.no_members(len(values))
        leaves[:, ROW] = np.arange(len(leaves))
        values[:, TEXTURE] = values[:, PROFILE] = -1.0
        distributions: list[NDArray[np.float32]] = []
        used = 0

        def distribution(row: int, made: tuple[NDArray[np.float32], tuple[int, int], float]) -> float:
            nonlocal used
            values[row, DISTRIBUTION], values[row, GRID : GRID + 2] = used, made[1]
            distributions.append(made[0])
            used += len(made[0])
            return made[2]

        solid: list[NDArray[np.float64]] = []  # boxes
        through_portals = {}  # brightness of what comes in by each dome's portals, by row
        for row, (light, kind, source) in enumerate(zip(lights, kinds, order, strict=True)):
            color = np.asarray(shine(light), np.float64)
            brightness = float(color @ LUMINANCE)
            first_texture = self._first_texture[source]
            values[row, KIND] = kind
            values[row, TRANSFORM : TRANSFORM + 12] = light.world_from_light[:3].ravel()
            values[row, ON_DIFFUSE : SHADOWLESS + 1] = light.diffuse, light.specular, not light.casts_shadows
            values[row, ON_INDIRECT] = light.indirect
            if light.shaping is not None and kind <= POINT:
                values[row, SHAPED : PROFILE + 1] = _shaping_columns(light.shaping, first_texture)
                leaves[row, BACK] = CONE
            texture = getattr(light, "texture", None)
            if texture is not None:
                image_row = first_texture + texture
                image = atlas.textures[image_row]
                values[row, TEXTURE] = image_row
                if image_row not in self._means:
                    self._means[image_row] = mean_luminance(image)
                brightness *= self._means[image_row]
            if kind <= POINT:
                lamp = _lamp(light, brightness)
                values[row, SIZE : SIZE + len(lamp.sizes)] = lamp.sizes
                leaves[row, CENTRE : CENTRE + 3] = light.world_from_light[:3, 3]
                leaves[row, NORMAL : NORMAL + 3] = light.world_from_light[:3, 2] * lamp.flat
                leaves[row, [ROUND, STRENGTH, SIZE2]] = not lamp.flat, max(lamp.strength, 0.0), lamp.size2
                if kind <= LAST_SOLID:
                    solid.append(_box(light, lamp))
                if texture is not None:
                    if image_row not in self._panels:
                        self._panels[image_row] = (*lamp_distribution(image), image_part(image))
                    values[row, IMAGE_PART] = distribution(row, self._panels[image_row])
            elif isinstance(light, DistantLight):
                half = 0.5 * light.angle
                values[row, SIZE : SIZE + 2] = math.cos(half), 2.0 * math.sin(0.5 * half) ** 2
                if light.angle > 0.0:
                    color = color / (math.pi * math.sin(half) ** 2)
                leaves[row, [ROUND, STRENGTH, SIZE2]] = 1.0, max(brightness, 0.0) * FAR2, FAR2
                values[row, SHADES] = -1.0
                if portals:
                    shades = _shades(light.world_from_light[:3, 2], [portal for _, portal in portals])
                    values[row, SHADES] = used
                    distributions.append(shades.astype(np.float32).ravel())
                    used += shades.size
            elif isinstance(light, DomeLight):
                part = 0.0
                if texture is not None:
                    if image_row not in self._skies:
                        self._skies[image_row] = (*dome_distribution(image), sun_part(image))
                        self._copies[image_row] = small_copy(image)
                    part = distribution(row, self._skies[image_row])
                    values[row, SMALL_COPY] = -1.0
                    copy = self._copies[image_row]
                    if part == 0.0 and copy is not None:
                        values[row, SMALL_COPY] = used
                        distributions.append(copy.ravel())
                        used += copy.size
                leaves[row, [ROUND, STRENGTH, SIZE2]] = not light.portals, max(brightness, 0.0), part / (1.0 - part)
                through_portals[row] = max(brightness, 0.0)
            values[row, RADIANCE : RADIANCE + 3] = color
        for row, (dome, portal) in enumerate(portals, len(lights)):
            matrix, area = portal.world_from_portal[:3], portal.width * portal.height
            values[row, KIND], values[row, DOME_ROW] = PORTAL, dome
            values[row, TRANSFORM : TRANSFORM + 12] = matrix.ravel()
            values[row, SIZE : SIZE + 2] = portal.width, portal.height
            leaves[row, CENTRE : CENTRE + 3], leaves[row, NORMAL : NORMAL + 3] = matrix[:, 3], matrix[:, 2]
            leaves[row, [STRENGTH, SIZE2]] = area * through_portals[dome], area / (2.0 * math.pi)

        ends = [0, *(int(np.searchsorted(kinds, kind)) for kind in (DISTANT, DOME)), len(lights), first_mesh]
        lamp_rows, distant_rows, dome_rows, portal_rows = (leaves[a:b] for a, b in itertools.pairwise(ends))
        for row, ((_, mesh, _), place) in enumerate(zip(self._meshes, self._places, strict=True), first_mesh):
            leaves[row] = mesh.placed(place)
            leaves[row, ROW] = row
        lamp_rows = np.concatenate([lamp_rows, leaves[first_mesh:]])
        nodes = light_tree.assembled(lamp_rows, portal_rows, distant_rows, dome_rows)
        nodes[0, [H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW, H_ROWS, H_END]] = *ends[1:], len(values)
        if self._meshes:
            nodes[0, H_CHOICE] = 1.0  # of triangles
        rows, places = light_tree.places(nodes[1:])
        values[rows, NODE] = LANES + places
        nodes = np.concatenate([nodes, *self._add_meshes(values[first_mesh:], len(nodes), used, distributions)])
        nodes[0, [H_SOLID_COUNT, H_BOXES]] = len(solid), ROWS * len(nodes)
        least, largest = np.reshape(solid, (-1, 2, 3)).transpose(1, 0, 2)
        nodes = np.concatenate([nodes.reshape(-1, LANES), light_bvh.boxes(least, largest, ROWS * len(nodes))])
        distributions.append(np.zeros(1, np.float32))
        known = self._distributions
        if len(known) != len(distributions) or not all(map(np.array_equal, known, distributions)):
            self._distributions, self._uploaded = distributions, upload(np.concatenate(distributions))
        return LightArrays(upload(values), upload_vectors(nodes), self._uploaded)

    def _add_meshes(
        self, rows: NDArray[np.float32], used_nodes: int, used: int, distributions: list[NDArray[np.float32]]
    ) -> list[NDArray[np.float32]]:
        """Fill in the rows of the instances that give light. Returns the trees of their meshes, each once."""
        trees: list[NDArray[np.float32]] = []
        known: dict[int, tuple[int, int]] = {}
        for row, (instance, mesh, first_triangle) in zip(rows, self._meshes, strict=True):
            if first_triangle not in known:
                known[first_triangle] = used_nodes, used
                nodes = light_tree.moved(mesh.nodes, used_nodes, first_triangle)
                triangles, places = light_tree.places(mesh.nodes)
                where = np.zeros(mesh.triangles, np.float32)
                where[triangles] = LANES * used_nodes + places
                trees.append(nodes)
                distributions.append(where)
                used_nodes += len(nodes)
                used += len(where)
            row[[KIND, INSTANCE, FIRST_TRIANGLE]] = MESH, instance, first_triangle
            row[[TREE, DISTRIBUTION]] = known[first_triangle]
            row[[TEXTURE, PROFILE]] = -1.0
            row[[ON_DIFFUSE, ON_SPECULAR, ON_INDIRECT]] = 1.0
        return trees

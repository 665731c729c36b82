# SPDX-License-Identifier: Apache-2.0
"""The light table: one row per light, the light tree, the BVH of lights, and distributions of textures, on the device.

Rows are sorted: lights that rays can hit, points, distant lights, domes; then portals and emissive meshes. What depends
on the kind of a light is in its entry in `light_kinds`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload, upload_vectors
from tiscene.scene.color import LUMINANCE
from tiscene.scene.description import DistantLight, DomeLight, Light, Portal, Shaping, Texture
from tiscene.scene.lights import light_bvh, light_tree
from tiscene.scene.lights.image_distribution import (
    area_distribution,
    dome_distribution,
    image_fraction,
    mean_luminance,
    small_image,
    sun_fraction,
)
from tiscene.scene.lights.light_groups import emission_of
from tiscene.scene.lights.light_kinds import (
    AREA,
    AT_INFINITY,
    LIGHT_KINDS,
    MESH,
    PORTAL,
    SURROUNDING,
    LightShape,
    close_registry,
    kind_of,
)
from tiscene.scene.lights.light_tree import (
    BACK,
    CENTER,
    CONE,
    FAR2,
    H_AREA_COUNT,
    H_BVH_ROW,
    H_DISTANT_ROW,
    H_DOME_ROW,
    H_END,
    H_HAS_CHOICE,
    H_PORTAL_ROW,
    H_ROWS,
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

# Columns of `LightArrays.values`.
#
# KIND: index in `LIGHT_KINDS`. TRANSFORM: world_from_light, 3x4 row-major. RADIANCE (3): before any texture, W/m²/sr; a
#     point's intensity, W/sr; a parallel distant light's irradiance, W/m².
# SIZE (2): `LightShape.sizes`; of a portal width and height, m; of a distant light the cosine of half its angle, and 1
#     minus that cosine.
# TEXTURE, FOCUS_TINT's PROFILE: row of the texture atlas, or -1.
# DISTRIBUTION, GRID (2): where the texture's CDF begins in `distribution`; its columns and rows. IMAGE_FRACTION: of the
#     samples of a rect that are drawn from its texture.
# SLOT: slot in the light tree.
# DOME_ROW: of a portal. PORTAL_MAPS: of a distant light, where `_portal_maps` begin in `distribution`; -1 without
#     portals. SMALL_IMAGE: of a dome, where `small_image` begins there; -1 if there is none.
# ON_DIFFUSE, ON_SPECULAR: multipliers of what diffuse and other lobes reflect. ON_INDIRECT: multiplier after the first
#     bounce. SHADOWLESS: 1 if nothing casts shadows in its light. UNSEEN: 1 if rays from the camera pass through it.
# INSTANCE, TREE: of an emissive mesh, in place of RADIANCE: row of the instance, root of its triangles' light tree. The
#     slots of all its triangles, 0 for none, are at DISTRIBUTION.
# SHAPED: 1 if the light has a Shaping. CONE_COSINE: of its cone's angle. CONE_EDGE (3): angles at which the soft edge
#     begins and ends, rad, and the cosine where it begins. FOCUS, FOCUS_TINT (3), PROFILE: as `Shaping`.
# CONE_REACH: of a shaped light in which not all meshes cast shadows, so that BSDF samples do not find its light: the
#     radius, m, of a ball about its origin that holds it. Of other lights 0.
# LIT, SHADOWING: where the light's `lit` and `shadowing` begin in `distribution`, a number per link class; -1: none.
COLUMNS = 43
KIND, TRANSFORM, RADIANCE, SIZE, TEXTURE, DISTRIBUTION, GRID, IMAGE_FRACTION = 0, 1, 13, 16, 18, 19, 20, 22
SLOT, DOME_ROW, PORTAL_MAPS, SMALL_IMAGE, ON_DIFFUSE, ON_SPECULAR, SHADOWLESS = 23, 24, 24, 24, 25, 26, 27
INSTANCE, TREE = 13, 14
SHAPED, CONE_COSINE, CONE_EDGE, FOCUS, FOCUS_TINT, PROFILE = 28, 29, 30, 33, 34, 37
ON_INDIRECT = 38
UNSEEN = 39
LIT, SHADOWING = 40, 41
CONE_REACH = 42

_ROUNDING = 1e-6  # boxes are enlarged by this fraction of their coordinates, against float32 rounding
_PORTAL_MARGIN = 0.05  # portals are enlarged by this fraction of their size, for rounding and the width of the sun
PORTAL_MAP_COLUMNS = 8

Floats = NDArray[np.float32]


class LightArrays(NamedTuple):
    """Device arrays of the light table.

    Attributes:
        values: f32 [lights + portals + emissive instances, COLUMNS].
        nodes: [m] vectors of 8, the light tree and the BVH of lights (see `light_tree`, `light_bvh`).
        distribution: f32 [k], CDFs of textures, filtered environment maps, portal maps, slots of triangles.
    """

    values: Any
    nodes: Any
    distribution: Any


def _shaping_columns(shaping: Shaping, first_texture: int) -> list[float]:
    """Return the columns from SHAPED to PROFILE."""
    inner, outer = (1.0 - shaping.cone_softness) * shaping.cone_angle, shaping.cone_angle
    # A cone of 180 degrees or more covers all directions; rounding must not exclude any.
    whole = outer >= math.pi
    cosines = (-2.0, -2.0) if whole else (math.cos(outer), math.cos(inner))
    profile = -1 if shaping.profile is None else first_texture + shaping.profile
    return [1.0, cosines[0], inner, outer, cosines[1], shaping.focus, *shaping.focus_tint, profile]


def _portal_maps(direction: NDArray[np.float64], portals: Sequence[Portal]) -> NDArray[np.float64]:
    """Return for each portal two affine maps of a point, [n, PORTAL_MAP_COLUMNS].

    They map a point to where the line from it along `direction` crosses the portal's plane, along the portal's x and y
    axes; both are in -1..1 inside the portal.
    """
    result = np.full((len(portals), PORTAL_MAP_COLUMNS), 2.0)
    result[:, [0, 1, 2, 4, 5, 6]] = 0.0
    for row, portal in zip(result, portals, strict=True):
        x, y, z, center = portal.world_from_portal[:3].T
        climb = float(direction @ z)
        if climb > 0.0:
            for side, axis, size in ((0, x, portal.width), (4, y, portal.height)):
                # (p + direction * ((center - p) . z / climb) - center) . axis
                slope = (axis - z * (direction @ axis) / climb) / ((0.5 + _PORTAL_MARGIN) * size)
                row[side : side + 4] = *slope, -slope @ center
    return result


def _box(light: Light, shape: LightShape) -> NDArray[np.float64]:
    """Return the bounding box, [2, 3], m, of a light."""
    matrix = light.world_from_light[:3]
    reach = np.abs(matrix[:, :3]) @ shape.box + np.sqrt(matrix[:, :3] ** 2 @ np.square(shape.ellipsoid))
    reach += _ROUNDING * (np.abs(matrix[:, 3]) + reach)
    return np.array([matrix[:, 3] - reach, matrix[:, 3] + reach])


class _Rows:
    """The rows of all lights in the light table and the light tree, while they are filled in.

    Args:
        count: Number of lights, portals and emissive instances.

    Attributes:
        values: float32 [count, COLUMNS], of `LightArrays.values`.
        leaves: float32 [count, light_tree.ATTRIBUTES].
        distributions: The parts of `LightArrays.distribution`.
    """

    def __init__(self, count: int) -> None:
        self.values, self.leaves = np.zeros((count, COLUMNS), np.float32), light_tree.empty_rows(count)
        self.values[:, [TEXTURE, PROFILE, LIT, SHADOWING]] = -1.0
        self.leaves[:, ROW] = np.arange(count)
        self.distributions: list[Floats] = []
        self._used = 0

    def add_distribution(self, part: NDArray[np.floating]) -> int:
        """Append a part; return where it begins."""
        begin, self._used = self._used, self._used + part.size
        self.distributions.append(part.astype(np.float32, copy=False).ravel())
        return begin

    def add_links(self, lights: Sequence[Light]) -> None:
        """Fill in the columns LIT and SHADOWING. Comes first: rays hold these places as float32."""
        begins: dict[tuple[bool, ...], int] = {}
        for value, light in zip(self.values, lights, strict=False):
            for column, link in ((LIT, light.lit), (SHADOWING, light.shadowing)):
                if link is not None:
                    if link not in begins:
                        begins[link] = self.add_distribution(np.array(link, np.float32))
                    value[column] = begins[link]

    def fill(self, row: int, light: Light, kind: int) -> None:
        """Fill in what all kinds of lights have."""
        value = self.values[row]
        value[KIND], value[TRANSFORM : TRANSFORM + 12] = kind, light.world_from_light[:3].ravel()
        value[ON_DIFFUSE : SHADOWLESS + 1] = light.diffuse, light.specular, not light.casts_shadows
        value[ON_INDIRECT], value[UNSEEN] = light.indirect, not light.seen_by_camera

    def fill_shape(self, row: int, light: Light, shape: LightShape, first_texture: int, image: Texture | None) -> None:
        """Fill in a light that has a position."""
        value, leaf = self.values[row], self.leaves[row]
        value[SIZE : SIZE + len(shape.sizes)] = shape.sizes
        leaf[CENTER : CENTER + 3] = light.world_from_light[:3, 3]
        leaf[NORMAL : NORMAL + 3] = light.world_from_light[:3, 2] * shape.flat
        leaf[[ROUND, STRENGTH, SIZE2]] = not shape.flat, max(shape.strength, 0.0), shape.size2
        if light.shaping is not None:
            value[SHAPED : PROFILE + 1] = _shaping_columns(light.shaping, first_texture)
            leaf[BACK] = CONE
            if not (light.casts_shadows and light.shadowing is None):
                value[CONE_REACH] = np.linalg.norm(shape.box) + max(shape.ellipsoid)
        if image is not None:
            self._fill_image(row, *area_distribution(image))
            value[IMAGE_FRACTION] = image_fraction(image)

    def fill_distant(self, row: int, light: DistantLight, luminance: float, portals: Sequence[Portal]) -> None:
        """Fill in a distant light of this irradiance, by luminance."""
        half = 0.5 * light.angle
        self.values[row, SIZE : SIZE + 2] = math.cos(half), 2.0 * math.sin(0.5 * half) ** 2
        self.leaves[row, [ROUND, STRENGTH, SIZE2]] = 1.0, max(luminance, 0.0) * FAR2, FAR2
        self.values[row, PORTAL_MAPS] = -1.0
        if portals:
            maps = _portal_maps(light.world_from_light[:3, 2], portals)
            self.values[row, PORTAL_MAPS] = self.add_distribution(maps)

    def fill_dome(self, row: int, light: DomeLight, luminance: float, image: Texture | None) -> None:
        """Fill in a dome of this mean radiance, by luminance."""
        fraction = 0.0
        if image is not None:
            self._fill_image(row, *dome_distribution(image))
            fraction, self.values[row, SMALL_IMAGE] = sun_fraction(image), -1.0
            copy = small_image(image) if fraction == 0.0 else None
            if copy is not None:
                self.values[row, SMALL_IMAGE] = self.add_distribution(copy)
        odds = fraction / (1.0 - fraction)
        self.leaves[row, [ROUND, STRENGTH, SIZE2]] = not light.portals, max(luminance, 0.0), odds

    def fill_portal(self, row: int, portal: Portal, dome: int, luminance: float) -> None:
        """Fill in a portal of the dome in a row, whose mean radiance has this luminance."""
        value, leaf = self.values[row], self.leaves[row]
        matrix, area = portal.world_from_portal[:3], portal.width * portal.height
        value[KIND], value[DOME_ROW], value[TRANSFORM : TRANSFORM + 12] = PORTAL, dome, matrix.ravel()
        value[SIZE : SIZE + 2] = portal.width, portal.height
        leaf[CENTER : CENTER + 3], leaf[NORMAL : NORMAL + 3] = matrix[:, 3], matrix[:, 2]
        leaf[[STRENGTH, SIZE2]] = area * max(luminance, 0.0), area / (2.0 * math.pi)

    def _fill_image(self, row: int, cdf: Floats, grid: tuple[int, int]) -> None:
        self.values[row, DISTRIBUTION], self.values[row, GRID : GRID + 2] = self.add_distribution(cdf), grid


class LightTable:
    """The lights of a scene. The device arrays are rebuilt when lights change."""

    def __init__(self) -> None:
        self.lights: list[Light] = []
        self._first_texture: list[int] = []
        self._meshes: list[tuple[int, MeshLight]] = []  # with the rows of their instances
        self._places: NDArray[np.float64] = np.zeros((0, 3, 4))
        self._arrays: LightArrays | None = None
        # LightArrays.distribution and its parts on the host: not uploaded again when a light moves.
        self._distributions: list[Floats] = []
        self._uploaded: Any = None

    def __len__(self) -> int:
        return len(self.lights)

    def place(self, lights: Sequence[tuple[int, Light]], first_textures: Sequence[int]) -> None:
        """Replace all lights; cheap if they are the same objects as before.

        Args:
            lights: The lights, each with the row of its description.
            first_textures: By description, the row of the atlas where its textures begin.
        """
        same = len(lights) == len(self.lights) and all(a is b for (_, a), b in zip(lights, self.lights, strict=True))
        if not same:
            self.lights = [light for _, light in lights]
            self._first_texture = [first_textures[row] for row, _ in lights]
            self._arrays = None

    def place_meshes(self, meshes: Sequence[tuple[int, MeshLight]], places: NDArray[np.float64]) -> None:
        """Replace all emissive meshes.

        Args:
            meshes: Row of the instance and its mesh of each, by ascending row.
            places: [n, 3, 4], their world_from_object.
        """
        if list(meshes) != self._meshes or not np.array_equal(places, self._places):
            self._meshes, self._places = list(meshes), places.copy()
            self._arrays = None

    @property
    def any_links(self) -> bool:
        """Whether light or shadow linking restricts a light."""
        return any(light.lit is not None or light.shadowing is not None for light in self.lights)

    @property
    def any_shadow_links(self) -> bool:
        """Whether shadow linking restricts a light."""
        return any(light.shadowing is not None for light in self.lights)

    @property
    def any_visible(self) -> bool:
        """Whether a light has an area and the camera sees it."""
        return any(LIGHT_KINDS[kind_of(light)].group == AREA and light.seen_by_camera for light in self.lights)

    def arrays(self, atlas: TextureAtlas) -> LightArrays:
        """Return the device arrays."""
        if self._arrays is None:
            self._arrays = self._build(atlas)
        return self._arrays

    def rows(self) -> NDArray[np.int64]:
        """Return the row in `LightArrays.values` of each of `lights`."""
        return np.argsort(np.array(self._order(), np.int64))

    def _order(self) -> list[int]:
        kinds = [kind_of(light) for light in self.lights]
        return sorted(range(len(kinds)), key=lambda row: (LIGHT_KINDS[kinds[row]].group, kinds[row]))

    def _build(self, atlas: TextureAtlas) -> LightArrays:
        close_registry()
        order = self._order()
        lights = [self.lights[row] for row in order]
        kinds = [kind_of(light) for light in lights]
        groups = [LIGHT_KINDS[kind].group for kind in kinds]
        domes = [(row, light) for row, light in enumerate(lights) if isinstance(light, DomeLight)]
        portals = [(row, portal) for row, dome in domes for portal in dome.portals]
        rows = _Rows(len(lights) + len(portals) + len(self._meshes))
        rows.add_links(lights)
        boxes: list[NDArray[np.float64]] = []
        of_dome: dict[int, float] = {}  # luminance, by row
        for row, (light, kind, source) in enumerate(zip(lights, kinds, order, strict=True)):
            color = np.asarray(emission_of(light), np.float64)
            luminance, image = float(color @ LUMINANCE), None
            first_texture, shape_of = self._first_texture[source], LIGHT_KINDS[kind].shape
            rows.fill(row, light, kind)
            texture = getattr(light, "texture", None)
            if texture is not None:
                rows.values[row, TEXTURE] = first_texture + texture
                image = atlas.textures[first_texture + texture]
                luminance *= mean_luminance(image)
            if shape_of is not None:
                shape = shape_of(light, luminance)
                rows.fill_shape(row, light, shape, first_texture, image)
                if groups[row] == AREA:
                    boxes.append(_box(light, shape))
            elif isinstance(light, DistantLight):
                rows.fill_distant(row, light, luminance, [portal for _, portal in portals])
                if light.angle > 0.0:
                    color = color / (math.pi * math.sin(0.5 * light.angle) ** 2)
            elif isinstance(light, DomeLight):
                rows.fill_dome(row, light, luminance, image)
                of_dome[row] = luminance
            rows.values[row, RADIANCE : RADIANCE + 3] = color
        for row, (dome, portal) in enumerate(portals, len(lights)):
            rows.fill_portal(row, portal, dome, of_dome[dome])
        ends = np.searchsorted(groups, (AT_INFINITY, SURROUNDING)).tolist()
        nodes = self._nodes(rows, [0, *ends, len(lights), len(lights) + len(portals)], boxes)
        rows.add_distribution(np.zeros(1))
        known, parts = self._distributions, rows.distributions
        if len(known) != len(parts) or not all(map(np.array_equal, known, parts)):
            self._distributions, self._uploaded = parts, upload(np.concatenate(parts))
        return LightArrays(upload(rows.values), upload_vectors(nodes), self._uploaded)

    def _nodes(self, rows: _Rows, ends: Sequence[int], boxes: Sequence[Any]) -> Floats:
        """Return the light tree and the BVH of lights; fill in the column SLOT and the rows of emissive instances.

        ends: 0, then where the rows of finite lights, distant lights, domes and portals end.
        """
        values, leaves, first_mesh = rows.values, rows.leaves, ends[-1]
        finite_rows, distant_rows, dome_rows, portal_rows = (leaves[a:b] for a, b in itertools.pairwise(ends))
        for row, ((_, mesh), place) in enumerate(zip(self._meshes, self._places, strict=True), first_mesh):
            leaves[row] = mesh.placed(place)
            leaves[row, ROW] = row
        finite_rows = np.concatenate([finite_rows, leaves[first_mesh:]])
        nodes = light_tree.assemble(finite_rows, portal_rows, distant_rows, dome_rows)
        nodes[0, [H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW, H_ROWS, H_END]] = *ends[1:], len(values)
        if self._meshes:
            nodes[0, H_HAS_CHOICE] = 1.0  # between triangles
        numbers, slots = light_tree.light_slots(nodes[1:])
        values[numbers, SLOT] = LANES + slots
        nodes = np.concatenate([nodes, *self._add_meshes(rows, first_mesh, len(nodes))])
        nodes[0, [H_AREA_COUNT, H_BVH_ROW]] = len(boxes), ROWS * len(nodes)
        lower, upper = np.reshape(boxes, (-1, 2, 3)).transpose(1, 0, 2)
        return np.concatenate([nodes.reshape(-1, LANES), light_bvh.build(lower, upper, ROWS * len(nodes))])

    def _add_meshes(self, rows: _Rows, first: int, used_nodes: int) -> list[Floats]:
        """Fill in the rows of emissive instances, from a row on; return the trees of their meshes, each once."""
        trees: list[Floats] = []
        known: dict[MeshLight, tuple[int, int]] = {}
        for value, (instance, mesh) in zip(rows.values[first:], self._meshes, strict=True):
            if mesh not in known:
                nodes = light_tree.rebased(mesh.nodes, used_nodes)
                triangles, slots = light_tree.light_slots(mesh.nodes)
                slot_of = np.zeros(mesh.triangles, np.float32)
                slot_of[triangles] = LANES * used_nodes + slots
                trees.append(nodes)
                known[mesh] = used_nodes, rows.add_distribution(slot_of)
                used_nodes += len(nodes)
            value[[KIND, INSTANCE]] = MESH, instance
            value[[TREE, DISTRIBUTION]] = known[mesh]
            value[[ON_DIFFUSE, ON_SPECULAR, ON_INDIRECT]] = 1.0
        return trees

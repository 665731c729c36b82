"""All lights of a scene: one row each, with the chance of being chosen, and the domes' sampling distributions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import (
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    Light,
    RectLight,
    Shaping,
    SphereLight,
    Texture,
)
from tiscene.scene.device_array import upload
from tiscene.scene.texture_atlas import TextureAtlas, linear_pixels

# Kinds of light, in the order of the rows: what a ray can meet comes first.
RECT, DISK, SPHERE, CYLINDER, POINT, DISTANT, DOME = range(7)
LAST_SOLID = CYLINDER

# Columns of `values`. TRANSFORM: world_from_light, 3x4 row-major. SIZE: rect width and height; disk and sphere radius;
# cylinder radius and length; distant: cosine of half the angle, 1 - that cosine. CHANCE: of being chosen; CUMULATIVE:
# the chances up to and including this row. TEXTURE: row of the atlas or -1. DISTRIBUTION, GRID: where a dome's begins,
# its columns and rows.
# PORTALS, PORTAL_COUNT: a dome's first, and how many. Portals are rows like rects, but dark, after those of the lights.
# SUN_PART: how many of the samples of a dome with portals are drawn from its image all the same, see `sun_part`.
# STRENGTH, by luminance: W/sr along the axis of what has a place, W/m² of a distant light, W/m²/sr of a dome.
# SHAPED: 1 where a light has a Shaping. CONE_COSINE: of its cone's angle; CONE_EDGE: the angles at which the soft edge
# begins and ends, and the cosine where it begins; FOCUS_TINT, PROFILE as TEXTURE.
# GROUP: which group of lights it is in; GROUPS, GROUP_COUNT: where those begin in `distribution`, and how many.
# ON_DIFFUSE, ON_SPECULAR: multipliers of the response. SHADOWLESS: 1 where nothing keeps its light off anything.
COLUMNS = 44
KIND, TRANSFORM, RADIANCE, SIZE, CHANCE, CUMULATIVE, TEXTURE, DISTRIBUTION, GRID = 0, 1, 13, 16, 18, 19, 20, 21, 22
PORTALS, PORTAL_COUNT, SUN_PART, STRENGTH = 24, 25, 26, 27
SHAPED, CONE_COSINE, CONE_EDGE, FOCUS, FOCUS_TINT, PROFILE, ON_DIFFUSE, ON_SPECULAR, SHADOWLESS = (
    28, 29, 30, 33, 34, 37, 38, 39, 40
)  # fmt: skip
GROUP, GROUPS, GROUP_COUNT = 41, 42, 43
# A group in `distribution`: how many lights, the sum of their STRENGTH, the middle of them, their mean squared
# distance from it (-1: they are looked at one by one, as light from infinity is); where the list of rows begins.
GROUP_COLUMNS = 7
G_COUNT, G_STRENGTH, G_MIDDLE, G_SIZE2, G_FIRST = 0, 1, 2, 5, 6

FEW = 16  # lights are looked at one by one

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_LARGEST_GRID = (512, 1024)
# This part of the choices ignores power, so that a strong light that is hidden from most of a scene (the sky of a
# closed room) does not starve the weak ones.
_UNIFORM_PART = 0.2
# What is so many times brighter than the image's mean is its sun, which no sampling of directions alone would find.
_SUN = 16.0


class LightArrays(NamedTuple):
    """values: f32 [n + portals, 44], columns as named above; distribution: f32 [m], see `dome_distribution`.

    total: how many lights (n); solid: the first so many can be met by a ray.
    """

    values: Any
    distribution: Any
    total: int
    solid: int


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


def dome_distribution(texture: Texture) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """What a latlong image is sampled by, in proportion to luminance times solid angle: (values, (columns, rows)).

    values: rows + 1 cumulative probabilities over the rows (from the image's top), then columns + 1 for every row.
    """
    luminance = linear_pixels(texture)[..., :3].astype(np.float64) @ _LUMINANCE
    # Lookups interpolate between pixel centres: this is each pixel's mean over its own square.
    luminance = 0.75 * luminance + 0.125 * (np.roll(luminance, 1, axis=1) + np.roll(luminance, -1, axis=1))
    padded = np.pad(luminance, ((1, 1), (0, 0)), mode="edge")
    luminance = 0.75 * luminance + 0.125 * (padded[:-2] + padded[2:])
    rows, columns = (min(size, limit) for size, limit in zip(luminance.shape, _LARGEST_GRID, strict=True))
    weight = _block_means(_block_means(luminance, rows).T, columns).T
    edges = np.cos(np.linspace(0.0, math.pi, rows + 1))
    weight = np.maximum(weight, 0.0) * (edges[:-1] - edges[1:])[:, None]
    weight += 1e-12 if weight.sum() <= 0.0 else 0.0
    marginal = _cumulative(weight.sum(axis=1)[None])
    conditional = _cumulative(weight + 1e-30)
    return np.concatenate([marginal.ravel(), conditional.ravel()]).astype(np.float32), (columns, rows)


def sun_part(texture: Texture) -> float:
    """The part, 0..0.75, of a latlong image's light that comes from its sun."""
    luminance = linear_pixels(texture)[..., :3].astype(np.float64) @ _LUMINANCE
    edges = np.cos(np.linspace(0.0, math.pi, len(luminance) + 1))
    light = np.maximum(luminance, 0.0) * ((edges[:-1] - edges[1:]) / (2.0 * luminance.shape[1]))[:, None]
    mean = float(light.sum())
    return 0.0 if mean <= 0.0 else min(float(light[luminance > _SUN * mean].sum()) / mean, 0.75)


def _block_means(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Means over `count` equal parts of axis 0, which need not divide it."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    edges = np.linspace(0.0, len(values), count + 1)
    low = np.minimum(edges.astype(int), len(values) - 1)
    part = (edges - low)[:, None]
    at_edges = sums[low] * (1.0 - part) + sums[low + 1] * part
    return np.asarray(np.diff(at_edges, axis=0) * (count / len(values)))


def _cumulative(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of n weights to rows of n + 1 cumulative probabilities."""
    sums = np.cumsum(weight, axis=1)
    return np.concatenate([np.zeros((len(weight), 1)), sums / sums[:, -1:]], axis=1)


def _shaping_columns(shaping: Shaping, first_texture: int) -> list[float]:
    """From SHAPED to PROFILE."""
    inner, outer = (1.0 - shaping.cone_softness) * shaping.cone_angle, shaping.cone_angle
    # A cone of half a turn or more leaves nothing out, and rounding must not.
    whole = outer >= math.pi
    cosines = (-2.0, -2.0) if whole else (math.cos(outer), math.cos(inner))
    profile = -1 if shaping.profile is None else first_texture + shaping.profile
    return [1.0, cosines[0], inner, outer, cosines[1], shaping.focus, *shaping.focus_tint, profile]


def grouped(values: NDArray[np.float32], count: int, offset: int) -> NDArray[np.float32]:
    """The groups of the first `count` rows, to be read from `offset` of `distribution`: one if they are FEW, else about
    as many as each has lights, by halving the longest side of their box. Notes in the rows which group they are in."""
    placed = np.flatnonzero((values[:count, KIND] < DISTANT) & (count > FEW))
    positions = values[:, TRANSFORM + 3 : TRANSFORM + 12 : 4]
    groups = [np.setdiff1d(np.arange(count), placed)]
    waiting = [placed]
    while waiting:
        rows = waiting.pop()
        if len(rows) ** 2 <= len(placed) or len(rows) == 1:
            groups.append(rows)
            continue
        longest = int(np.argmax(np.ptp(positions[rows], axis=0)))
        rows = rows[np.argsort(positions[rows, longest], kind="stable")]
        waiting += [rows[: len(rows) // 2], rows[len(rows) // 2 :]]
    groups = [rows for rows in groups if len(rows)]
    table = np.zeros((len(groups), GROUP_COLUMNS), np.float32)
    first = offset + table.size
    for number, rows in enumerate(groups):
        middle = positions[rows].mean(axis=0)
        size2 = float(positions[rows].var(axis=0).sum()) if rows[0] in placed else -1.0
        table[number] = len(rows), values[rows, STRENGTH].sum(), *middle, size2, first
        first += len(rows)
        values[rows, GROUP] = number
    values[:count, GROUPS], values[:count, GROUP_COUNT] = offset, len(groups)
    return np.concatenate([table.ravel(), *groups, np.zeros(1)]).astype(np.float32)


class LightTable:
    """Grows by `append`; the device arrays are made anew when the lights or the size of the scene change."""

    def __init__(self) -> None:
        self.lights: list[Light] = []
        self._first_texture: list[int] = []
        self._built: tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]] | None = None
        self._distribution: Any = None
        self._arrays: LightArrays | None = None
        self._radius = -1.0
        self._skies: dict[int, tuple[NDArray[np.float32], tuple[int, int], float]] = {}  # by row of the atlas
        self._means: dict[int, float] = {}  # luminance of the lights' textures, by row of the atlas

    def __len__(self) -> int:
        return len(self.lights)

    def append(self, lights: Iterable[Light], first_texture: int) -> int:
        """Add lights whose textures begin at a row of the atlas. Returns how many there were before."""
        before = len(self.lights)
        self.lights.extend(lights)
        self._first_texture += [first_texture] * (len(self.lights) - before)
        self._built = self._arrays = None
        return before

    def replace(self, row: int, light: Light) -> None:
        """Put another light of the same kind in the place of one."""
        self.lights[row] = light
        self._built = self._arrays = None

    def place(self, lights: Sequence[Light], first_textures: Sequence[int]) -> None:
        """These are the lights from now on, in the place of all that were there; cheap where they are the same ones.

        first_textures: for each, the row of the atlas where its description's textures begin.
        """
        same = len(lights) == len(self.lights) and all(a is b for a, b in zip(lights, self.lights, strict=True))
        if not same:
            self.lights, self._first_texture = list(lights), list(first_textures)
            self._built = self._arrays = None

    def arrays(self, atlas: TextureAtlas, radius: float) -> LightArrays:
        """What kernels read. radius: of a sphere about the scene, m; the share of light from infinity depends on it,
        unless domes have portals: those say how much of it comes in.
        """
        if self._built is None:
            self._build(atlas)
        assert self._built is not None
        if self._arrays is None or radius != self._radius:
            values, power, power_per_area = self._built
            self._radius = radius
            count = len(self.lights)
            portals = values[count:]
            area = float(portals[:, SIZE] @ portals[:, SIZE + 1]) if len(portals) else math.pi * radius * radius
            total = power + power_per_area * area
            chance = np.full(len(total), 1.0 / max(len(total), 1))
            if total.sum() > 0.0:
                chance = _UNIFORM_PART * chance + (1.0 - _UNIFORM_PART) * total / total.sum()
            values[:count, CHANCE] = chance
            values[:count, CUMULATIVE] = np.cumsum(chance)
            solid = int(np.count_nonzero(values[:count, KIND] <= LAST_SOLID))
            self._arrays = LightArrays(upload(values), self._distribution, count, solid)
        return self._arrays

    def _build(self, atlas: TextureAtlas) -> None:
        """Rows without their chances; per light the power, W, and for light from infinity the power per area, W/m²."""
        order = sorted(range(len(self.lights)), key=lambda row: kind_of(self.lights[row]))
        portals = [portal for light in self.lights if isinstance(light, DomeLight) for portal in light.portals]
        values = np.zeros((len(order) + len(portals), COLUMNS), np.float32)
        next_portal = len(order)
        power, power_per_area = np.zeros(len(order)), np.zeros(len(order))
        distributions: list[NDArray[np.float32]] = []
        used = 0
        for row, source in enumerate(order):
            light = self.lights[source]
            kind = kind_of(light)
            color = np.asarray(light.irradiance if isinstance(light, DistantLight) else light.radiance, np.float64)  # type: ignore[attr-defined]
            brightness, strength = float(color @ _LUMINANCE), 0.0
            values[row, KIND] = kind
            values[row, TRANSFORM : TRANSFORM + 12] = light.world_from_light[:3].ravel()
            values[row, TEXTURE] = -1.0
            values[row, ON_DIFFUSE : SHADOWLESS + 1] = light.diffuse, light.specular, not light.casts_shadows
            if light.shaping is not None and kind <= POINT:
                values[row, SHAPED : PROFILE + 1] = _shaping_columns(light.shaping, self._first_texture[source])
            texture = getattr(light, "texture", None)
            if texture is not None:
                image_row = self._first_texture[source] + texture
                image = atlas.textures[image_row]
                values[row, TEXTURE] = image_row
                if image_row not in self._means:
                    self._means[image_row] = float((linear_pixels(image)[..., :3] @ _LUMINANCE).mean())
                brightness *= self._means[image_row]
            match light:
                case RectLight():
                    values[row, SIZE : SIZE + 2] = light.width, light.height
                    strength = light.width * light.height * brightness
                    power[row] = math.pi * strength
                case DiskLight():
                    values[row, SIZE] = light.radius
                    strength = math.pi * light.radius**2 * brightness
                    power[row] = math.pi * strength
                case SphereLight():
                    values[row, SIZE] = light.radius
                    strength = brightness * (math.pi * light.radius**2 if kind == SPHERE else 1.0)
                    power[row] = 4.0 * math.pi * strength
                case CylinderLight():
                    values[row, SIZE : SIZE + 2] = light.radius, light.length
                    strength = 2.0 * light.radius * light.length * brightness
                    power[row] = math.pi**2 * strength
                case DistantLight():
                    half = 0.5 * light.angle
                    one_minus_cosine = 2.0 * math.sin(0.5 * half) ** 2
                    values[row, SIZE : SIZE + 2] = math.cos(half), one_minus_cosine
                    if light.angle > 0.0:
                        color = color / (math.pi * math.sin(half) ** 2)
                    strength = power_per_area[row] = brightness
                    values[row, PORTALS], values[row, PORTAL_COUNT] = len(order), len(portals)
                case DomeLight():
                    # What passes through a flat portal from one side; a scene without them is lit from all sides.
                    strength = brightness
                    power_per_area[row] = (1.0 if portals else 4.0) * math.pi * brightness
                    values[row, PORTALS], values[row, PORTAL_COUNT] = next_portal, len(light.portals)
                    for portal in light.portals:
                        values[next_portal, TRANSFORM : TRANSFORM + 12] = portal.world_from_portal[:3].ravel()
                        values[next_portal, SIZE : SIZE + 2] = portal.width, portal.height
                        values[next_portal, TEXTURE] = -1.0
                        next_portal += 1
                    if texture is not None:
                        if image_row not in self._skies:
                            self._skies[image_row] = (*dome_distribution(image), sun_part(image))
                        distribution, grid, values[row, SUN_PART] = self._skies[image_row]
                        values[row, DISTRIBUTION], values[row, GRID : GRID + 2] = used, grid
                        distributions.append(distribution)
                        used += len(distribution)
            values[row, STRENGTH] = strength
            values[row, RADIANCE : RADIANCE + 3] = color
        distributions.append(grouped(values, len(order), used))
        self._distribution = upload(np.concatenate(distributions))
        self._built = values, power, power_per_area

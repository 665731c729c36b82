# SPDX-License-Identifier: Apache-2.0
"""NumPy functions that sample and evaluate one material or one light, for tests."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, vec2, vec3
from tiscene.device.memory import upload
from tiscene.render.bsdfs import preview_surface_bsdf as bsdf
from tiscene.render.bsdfs.energy_tables import energy_tables
from tiscene.render.bsdfs.material_inputs import ALL_INPUTS, Footprint, Materials, material_at
from tiscene.render.intersect.surface_interaction import VisibleSurface
from tiscene.render.lights import dispatch
from tiscene.render.lights.importance import EntryWeights, weigh_entries
from tiscene.render.lights.light_sample import LightTables
from tiscene.render.texture_lookup import Textures
from tiscene.scene.description import Light, Material, Texture
from tiscene.scene.lights.light_kinds import POINT
from tiscene.scene.lights.light_table import LightTable
from tiscene.scene.lights.light_tree import MAX_ENTRIES
from tiscene.scene.material_table import MaterialTable
from tiscene.scene.textures.atlas import TextureAtlas


@ti.func
def row_of(array: ti.template(), i: ti.i32) -> vec3:
    """Read a row of three columns."""
    return vec3(array[i, 0], array[i, 1], array[i, 2])


@ti.kernel
@bundled
def scatter(
    materials: Materials,
    textures: Textures,
    energy: Floats1,
    row: ti.i32,
    front: ti.i32,
    samples: ti.i32,
    uv: Floats2,
    outgoing: Floats2,
    numbers: Floats2,
    incoming: Floats2,
    values: Floats2,
):
    """Evaluate a material: (f |cos|, density) of the directions `incoming` into `values`.

    Args:
        samples: 1: first sample `incoming` from `numbers`.
    """
    for i in range(outgoing.shape[0]):
        surface = VisibleSurface(material=row, uv=vec2(uv[i, 0], uv[i, 1]))
        point = material_at(materials, textures, surface, ALL_INPUTS, Footprint())
        closure = bsdf.closure_at(point, energy, row_of(outgoing, i), front)
        if samples != 0:
            wi = bsdf.sample(closure, row_of(numbers, i), bsdf.LOBES)
            for c in ti.static(range(3)):
                incoming[i, c] = wi[c]
        value, _ = bsdf.evaluate(closure, energy, row_of(incoming, i), bsdf.LOBES)
        for c in ti.static(range(4)):
            values[i, c] = value[c]


@dataclass
class Bsdf:
    """A material in its shading frame.

    Args:
        material: The material.
        textures: Its textures.
        front: Whether it is seen from outside.
    """

    material: Material
    textures: tuple[Texture, ...] = ()
    front: bool = True

    def __post_init__(self) -> None:
        table, atlas = MaterialTable(), TextureAtlas()
        table.append((self.material,), atlas.append(self.textures))
        self.arrays: tuple[Any, ...] = (*table.arrays(), *atlas.arrays(), upload(energy_tables(table.glass_iors)))

    def sample(self, outgoing: NDArray[Any], numbers: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Sample directions [n, 3] from numbers [n, 3]; return them and their (f |cos|, density) [n, 4]."""
        incoming = np.empty((len(outgoing), 3), np.float32)
        return incoming, self._run(outgoing, incoming, numbers)

    def evaluate(self, outgoing: NDArray[Any], incoming: NDArray[Any]) -> NDArray[np.float64]:
        """Return (f |cos|, density) [n, 4] of pairs of directions."""
        return self._run(outgoing, np.ascontiguousarray(incoming, np.float32), None)

    def _run(self, outgoing: NDArray[Any], incoming: NDArray[Any], numbers: NDArray[Any] | None) -> NDArray[np.float64]:
        values = np.empty((len(outgoing), 4), np.float32)
        scatter(
            *self.arrays,
            0,
            int(self.front),
            int(numbers is not None),
            np.full((len(outgoing), 2), 0.5, np.float32),
            np.ascontiguousarray(outgoing, np.float32),
            np.ascontiguousarray(np.zeros((1, 3)) if numbers is None else numbers, np.float32),
            incoming,
            values,
        )
        return values.astype(np.float64)


@ti.kernel
@bundled
def illuminate(
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    textures: Textures,
    samples: ti.i32,
    origins: Floats2,
    numbers: Floats2,
    directions: Floats2,
    radiance: Floats2,
    results: Floats2,
):
    """Sample or intersect the first light.

    Args:
        samples: 1: sample directions from numbers, with their radiance; write (density, distance, delta) to columns 0-2
            of `results`.
        results: Columns 3-5 always receive (density, distance, green radiance) of a ray in each direction.
    """
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution))
    for i in range(directions.shape[0]):
        origin = row_of(origins, 0)
        if samples != 0:
            u = vec2(numbers[i, 0], numbers[i, 1])
            found = dispatch.sample(lights, textures, origin, vec3(0.0), u)
            for c in ti.static(range(3)):
                directions[i, c] = found.direction[c]
                radiance[i, c] = found.radiance[c]
            results[i, 0] = found.pdf
            results[i, 1] = found.distance
            results[i, 2] = found.delta
        direction = row_of(directions, i)
        distance = dispatch.intersect(lights, 0, origin, direction)
        infinite = light_values[0, dispatch.KIND] > POINT + 0.5
        results[i, 3] = 0.0
        results[i, 4] = distance
        results[i, 5] = 0.0
        if distance < ti.math.inf or infinite:
            weights = ti.Vector.zero(ti.f32, MAX_ENTRIES)
            count, scale, _ = weigh_entries(lights, origin, vec3(0.0), weights, weights, False)
            entries = ti.static(EntryWeights(weights, weights, count, scale, scale))
            results[i, 3] = dispatch.pdf(lights, entries, 0, -1, origin, direction, distance)
            results[i, 5] = dispatch.emitted(lights, textures, 0, origin, direction, distance, results[i, 3]).y


@dataclass
class Illumination:
    """One light as seen from a point.

    Args:
        light: The light.
        origin: The point.
        textures: The light's textures.
    """

    light: Light
    origin: tuple[float, float, float]
    textures: tuple[Texture, ...] = ()

    def __post_init__(self) -> None:
        table, atlas = LightTable(), TextureAtlas()
        table.place([(0, self.light)], [atlas.append(self.textures)])
        self.arrays: tuple[Any, ...] = (*table.arrays(atlas), *atlas.arrays())

    def sample(self, numbers: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return (directions [n, 3], radiance [n, 3], results [n, 6]), see `illuminate`."""
        directions = np.empty((len(numbers), 3), np.float32)
        return directions, *self._run(directions, numbers)

    def seen(self, directions: NDArray[Any]) -> NDArray[Any]:
        """Return (density, distance, green radiance) [n, 3] of rays."""
        return self._run(np.ascontiguousarray(directions, np.float32), None)[1][:, 3:]

    def _run(self, directions: NDArray[Any], numbers: NDArray[Any] | None) -> tuple[NDArray[Any], NDArray[Any]]:
        radiance = np.zeros((len(directions), 3), np.float32)
        results = np.zeros((len(directions), 6), np.float32)
        illuminate(
            *self.arrays,
            int(numbers is not None),
            np.array([self.origin], np.float32),
            np.zeros((1, 2), np.float32) if numbers is None else np.ascontiguousarray(numbers, np.float32),
            directions,
            radiance,
            results,
        )
        return radiance.astype(np.float64), results.astype(np.float64)

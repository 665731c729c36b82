# SPDX-License-Identifier: Apache-2.0
"""NumPy functions that sample and evaluate one material with extended lobes, for tests."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tests.render.shading import Bsdf, row_of
from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Floats1, Floats2, vec2
from tiscene.device.memory import upload
from tiscene.render.bsdfs import extended_surface_bsdf as bsdf
from tiscene.render.bsdfs.energy_tables import energy_tables
from tiscene.render.bsdfs.lobe_inputs import lobe_inputs_at
from tiscene.render.bsdfs.material_inputs import ALL_INPUTS, Footprint, Materials, material_at
from tiscene.render.bsdfs.preview_surface_bsdf import evaluate, sample
from tiscene.render.intersect.surface_interaction import VisibleSurface
from tiscene.render.texture_lookup import Textures
from tiscene.scene.material_table import MaterialTable
from tiscene.scene.textures.atlas import TextureAtlas


@ti.kernel
@bundled
def scatter(
    materials: Materials,
    textures: Textures,
    energy: Floats1,
    front: ti.i32,
    samples: ti.i32,
    outgoing: Floats2,
    numbers: Floats2,
    incoming: Floats2,
    values: Floats2,
):
    """Evaluate material 0: (f |cos|, density) of the directions `incoming` into `values`; samples: 1: sample them."""
    for i in range(outgoing.shape[0]):
        surface = VisibleSurface(material=0, uv=vec2(0.5, 0.5))
        point = material_at(materials, textures, surface, ALL_INPUTS, Footprint())
        lobes = lobe_inputs_at(materials, textures, surface, 1, Footprint())
        closure = bsdf.extended_closure_at(point, lobes, energy, row_of(outgoing, i), front)
        if samples != 0:
            wi = sample(closure, row_of(numbers, i), bsdf.EXTENDED_LOBES)
            for c in ti.static(range(3)):
                incoming[i, c] = wi[c]
        value, _ = evaluate(closure, energy, row_of(incoming, i), bsdf.EXTENDED_LOBES)
        for c in ti.static(range(4)):
            values[i, c] = value[c]


class ExtendedBsdf(Bsdf):
    """A material with extended lobes in its shading frame, whose x axis is the direction of u."""

    def __post_init__(self) -> None:
        table, atlas = MaterialTable(), TextureAtlas()
        table.append((self.material,), atlas.append(self.textures))
        energy = upload(energy_tables(table.glass_iors, extended=True))
        self.arrays: tuple[Any, ...] = (*table.arrays(), *atlas.arrays(), energy)

    def _run(self, outgoing: NDArray[Any], incoming: NDArray[Any], numbers: NDArray[Any] | None) -> NDArray[np.float64]:
        values = np.empty((len(outgoing), 4), np.float32)
        drawn = np.ascontiguousarray(np.zeros((1, 3)) if numbers is None else numbers, np.float32)
        made = np.ascontiguousarray(outgoing, np.float32)
        scatter(*self.arrays, int(self.front), int(numbers is not None), made, drawn, incoming, values)
        return values.astype(np.float64)

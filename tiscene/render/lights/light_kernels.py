# SPDX-License-Identifier: Apache-2.0
"""The kernels of each kind of light, and `register_light` to add a kind from outside the package.

`LIGHT_KERNELS` is the tuple that `dispatch` unrolls (`ti.static`). The kernels of a built-in kind are the functions of
the module of this package that has the kind's name, as far as rays hit it. A kind consists of five functions of Taichi
(`ti.func`)::

    sample(lights, textures, row, origin, u) -> LightSample        a direction to the light; u: uniform in [0, 1)²
    pdf(lights, row, origin, direction, distance) -> f32           density of `sample`, 1/sr, for a ray that hits
    intersect(lights, row, origin, direction) -> f32               distance, +inf for a miss
    emitted(lights, textures, row, origin, direction, distance)    radiance along a ray that hits, vec3
    normal_at(values, row, point) -> vec3                          surface normal, for UsdLux's focus; may be left out

`lights` is a LightTables, `row` the light's row in `lights.values`; `light_sample` has the functions that read it.
"""

import importlib
from typing import Any, NamedTuple

from tiscene.scene.lights.light_kinds import LIGHT_KINDS, MESH, LightKind, add_kind, remove_kind


class LightKernels(NamedTuple):
    """The functions of one kind. kind: its index in `LIGHT_KINDS`; normal_at: None for built-in kinds."""

    kind: int
    sample: Any
    pdf: Any = None
    intersect: Any = None
    emitted: Any = None
    normal_at: Any = None

    def has(self, function: str) -> bool:
        """Return whether the kind has a function of that name."""
        return getattr(self, function) is not None


def _built_in(code: int) -> LightKernels:
    module = importlib.import_module(f"{__package__}.{LIGHT_KINDS[code].name}")
    found = {name: getattr(module, name, None) for name in ("sample", "pdf", "intersect", "emitted")}
    return LightKernels(code, **found)


# Functions instead of modules: recordings of kernels are keyed by the sources of the functions that they name.
# Emissive meshes are not in the list: their functions have other parameters, and no kernel without meshes calls them.
LIGHT_KERNELS = [_built_in(code) for code in range(MESH)]
BUILT_IN_KERNELS = len(LIGHT_KERNELS)


def register_light(
    kind: LightKind, *, sample: Any, pdf: Any, intersect: Any, emitted: Any, normal_at: Any = None
) -> LightKind:
    """Add a kind of light, before the first scene is rendered in the process.

    Args:
        kind: Its entry, with a class of lights, their shape, and, to read it from USD, functions by prim type.
        sample: See the module's docstring, as for the other functions.
        pdf: Density of `sample`.
        intersect: Distance to the light.
        emitted: Radiance.
        normal_at: Surface normal; None: the direction of emission, so that UsdLux's focus has no effect.

    Returns:
        The entry.

    Raises:
        ArgumentError: The name is taken, the entry is incomplete, or a scene was rendered before.
    """
    LIGHT_KERNELS.append(LightKernels(add_kind(kind), sample, pdf, intersect, emitted, normal_at))
    return kind


def unregister_light(name: str) -> None:
    """Remove the kind that was registered last.

    Raises:
        ArgumentError: It has another name.
    """
    remove_kind(name)
    LIGHT_KERNELS.pop()

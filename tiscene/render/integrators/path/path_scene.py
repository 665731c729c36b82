# SPDX-License-Identifier: Apache-2.0
"""Scene data for the path tracing kernels: device arrays, and what they contain."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from tiscene.render.integrators.path.radiance_cache import RadianceCache, last_depth
from tiscene.render.intersect.surface_interaction import Geometry, geometry_of
from tiscene.render.view import SKY
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_table import LightArrays
from tiscene.scene.material_table import MaterialArrays
from tiscene.scene.placement import CURRENT
from tiscene.scene.textures.atlas import TextureArrays

# Alpha-rejected surfaces that a path passes without counting them as path depth.
MAX_ALPHA_LAYERS = 16
# Surfaces that a shadow ray passes where shadow linking restricts a light.
MAX_UNLINKED_LAYERS = 256
# Where fewer paths are left, launches take longer than their paths.
FEW_PATHS = 1 << 10


@dataclass(frozen=True, eq=False)
class PathScene:
    """Scene data for the path tracing kernels.

    Attributes:
        geometry, materials, textures, lights: Device arrays.
        energy: Device array of `energy_tables`.
        any_coverage: Whether a material is partially opaque (alpha), so that hits may be rejected.
        any_emission: Whether a material is emissive.
        any_extended: Whether a material has extended lobes.
        ends_at_lights: Whether the last segment of a path contributes only if it reaches a light: no surface emits and
            no hit is ever rejected.
        tree: Tree that paths are traced through: CURRENT for all instances.
        any_links: Whether light or shadow linking restricts a light.
        any_shadow_links: Whether shadow linking does.
        cache: Light in which paths may end; None: they go on.
        first_group: Whether its lights are those of the first light group, to which a background of one color belongs.
    """

    geometry: Geometry
    materials: MaterialArrays
    textures: TextureArrays
    lights: LightArrays
    energy: Any
    any_coverage: bool
    any_emission: bool
    any_extended: bool
    ends_at_lights: bool
    tree: int = CURRENT
    any_links: bool = False
    any_shadow_links: bool = False
    cache: RadianceCache | None = None
    first_group: bool = True

    @classmethod
    def of(cls, scene: DeviceScene, lights: LightArrays, energy: Any) -> Self:
        """Return the data of a scene as it is now.

        Args:
            scene: The scene.
            lights: Lights to sample.
            energy: Device array of `energy_tables`.
        """
        materials = scene.materials
        return cls(
            geometry_of(scene),
            materials.arrays(),
            scene.textures.arrays(),
            lights,
            energy,
            any_coverage=materials.any_coverage,
            any_emission=materials.any_emission,
            any_extended=materials.any_extended,
            ends_at_lights=not (materials.any_coverage or materials.any_emission),
            any_links=scene.lights.any_links,
            any_shadow_links=scene.lights.any_shadow_links,
        )

    @cached_property
    def arrays(self) -> tuple[Any, ...]:
        """All device arrays, in the order in which `shade` and `continue_shadow_rays` take them."""
        return *self.geometry, *self.materials, *self.textures, *self.lights, self.energy

    @property
    def shadow_layers(self) -> int:
        """Surfaces that a shadow ray may pass."""
        return MAX_UNLINKED_LAYERS if self.any_shadow_links else MAX_ALPHA_LAYERS

    def steps(self, max_depth: int) -> int:
        """Return how many times paths may be advanced."""
        return max_depth + (MAX_ALPHA_LAYERS if self.any_coverage else 0)

    def background_of(self, background: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return what camera rays that hit nothing show, given `View.background`."""
        return background if self.first_group or background == SKY else (0.0, 0.0, 0.0)

    def segments_at_once(self, live: int, left: int) -> int:
        """Return how many of the last `left` segments of `live` paths `shade` may trace in one launch.

        All but the last where few paths are left; one where surfaces may let shadow rays pass.
        """
        passable = self.any_coverage or self.any_shadow_links
        return 1 if passable or live > FEW_PATHS else max(1, left - 1)

    def cache_arguments(self, max_depth: int) -> tuple[Any, ...]:
        """Return the cache as arguments of `shade`, and after how many surfaces paths may end in it."""
        if self.cache:
            return *self.cache, last_depth(max_depth)
        return self.lights.nodes, 1, 0.0, 0.0, 0.0, 0  # an array of that type, which is not read

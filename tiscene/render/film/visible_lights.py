# SPDX-License-Identifier: Apache-2.0
"""Pixels that show a light: labels have the surface behind it, whose albedo and normal are not those of the picture."""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints2
from tiscene.render.lights.intersect import nearest_light
from tiscene.render.lights.light_sample import LightTables
from tiscene.render.view import View, camera_ray
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT


def visible_lights(scene: DeviceScene, view: View, distance: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return whether the center of each pixel shows a light of the scene in front of all surfaces.

    Args:
        scene: The scene, as placed.
        view: Camera and image size.
        distance: float32 [h, w], of the surface, m; infinity where there is none.

    Returns:
        bool [h, w].
    """
    shown = np.zeros(distance.shape, np.int32)
    lights = scene.lights.arrays(scene.textures)
    _find(*lights, view.array(), view.width, view.height, distance, shown)
    return shown > 0


@ti.kernel
def _find(
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    distance: Floats2,
    shown: Ints2,
):
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution, with_links=False))
    for y, x in ti.ndrange(height, width):
        origin, direction = camera_ray(view, CURRENT, ti.cast(x, ti.f32), ti.cast(y, ti.f32), width, height)
        light, _ = nearest_light(lights, 0, origin, direction, distance[y, x])
        shown[y, x] = ti.cast(light >= 0, ti.i32)

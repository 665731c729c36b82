# SPDX-License-Identifier: Apache-2.0
"""Lights of a scene description, one class for each kind of UsdLux light.

A light emits along -z of its own space. Radiance is in W/m²/sr, scene-linear Rec.709.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.material_description import Color

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Shaping:
    """UsdLux's ShapingAPI: factors of the radiance that a point of a light emits in a direction.

    Below, t is the angle between the direction and the light's axis, -z, and c is the cosine of the angle between the
    direction and the light's surface normal.

    Attributes:
        cone_angle: rad; nothing is emitted where t is larger.
        cone_softness: 0..1, the fraction of the cone over which its edge fades:
            `1 - smoothstep((1 - softness) * cone_angle, cone_angle, t)`.
        focus: Exponent of the color `lerp(focus_tint, 1, |c| ** focus)`.
        focus_tint: Color of the light off the axis.
        profile: IES profile, as a texture of factors (row of `SceneDescription.textures`), read at u = p / (2 pi) and
            v = 1 - t / pi, with p the angle from +x towards +y. None: no profile.
    """

    cone_angle: float = math.pi
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: Color = (0.0, 0.0, 0.0)
    profile: int | None = None


@dataclass(frozen=True, eq=False)
class Light:
    """Base class of the lights.

    Attributes:
        name: Name of the prim.
        prim_path: Path on the stage.
        world_from_light: float64 4x4, rigid; scale is applied to the sizes.
        diffuse: Factor of the light that diffuse lobes reflect.
        specular: Factor of the light that all other lobes reflect.
        indirect: Factor of the light on surfaces that the camera sees by way of others.
        shaping: None: emits alike in all directions.
        casts_shadows: False: nothing blocks the light.
        seen_by_camera: False: the camera sees what is behind the light; mirrors and glass still show it.
        lit: Light linking: for each link class (`Mesh.link_class`) whether the light lights its meshes. None: it lights
            all.
        shadowing: Shadow linking: for each link class whether its meshes cast shadows in the light. None: all do.
    """

    name: str
    prim_path: str
    world_from_light: Matrix
    _: KW_ONLY
    diffuse: float = 1.0
    specular: float = 1.0
    indirect: float = 1.0
    shaping: Shaping | None = None
    casts_shadows: bool = True
    seen_by_camera: bool = True
    lit: tuple[bool, ...] | None = None
    shadowing: tuple[bool, ...] | None = None


@dataclass(frozen=True, eq=False)
class RectLight(Light):
    """A rectangle in the light's xy plane that emits towards -z.

    Attributes:
        radiance: W/m²/sr.
        width: m, along x.
        height: m, along y.
        texture: Factor of the radiance, row of `SceneDescription.textures`. None: constant.
    """

    radiance: Color
    width: float
    height: float
    texture: int | None = None


@dataclass(frozen=True, eq=False)
class DiskLight(Light):
    """A disk in the light's xy plane that emits towards -z. `radiance` in W/m²/sr, `radius` in m."""

    radiance: Color
    radius: float


@dataclass(frozen=True, eq=False)
class SphereLight(Light):
    """A sphere about the light's origin that emits outwards.

    Attributes:
        radiance: W/m²/sr; of a point light the intensity, W/sr.
        radius: m. 0: a point light.
    """

    radiance: Color
    radius: float


@dataclass(frozen=True, eq=False)
class CylinderLight(Light):
    """The side of a cylinder about the light's x axis, without caps; emits outwards.

    Attributes:
        radiance: W/m²/sr.
        radius: m.
        length: m.
    """

    radiance: Color
    radius: float
    length: float


@dataclass(frozen=True, eq=False)
class DistantLight(Light):
    """Light from infinity that travels along -z.

    Attributes:
        irradiance: W/m² on a plane that faces it.
        angle: rad, the full angle of the cone that it comes from.
    """

    irradiance: Color
    angle: float = 0.0


@dataclass(frozen=True, eq=False)
class Portal:
    """A rectangle in its own xy plane through which a dome's light enters a room, along -z.

    Portals direct the sampling of a dome; they do not block its light elsewhere.

    Attributes:
        world_from_portal: float64 4x4, rigid.
        width: m.
        height: m.
    """

    world_from_portal: Matrix
    width: float
    height: float


@dataclass(frozen=True, eq=False)
class DomeLight(Light):
    """An environment map.

    A direction d in light space reads the image at u = (atan2(d.z, d.x) + pi/2) / (2 pi), v = 1 - acos(d.y) / pi, where
    v = 1 is the top row: +y is the top, +z the center, +x a quarter from the left (OpenUSD's latlong convention).

    Attributes:
        radiance: W/m²/sr; multiplies the texture.
        texture: Latlong image, row of `SceneDescription.textures`. None: constant.
        portals: Points on the -z side of one of them sample the dome through these alone.
    """

    radiance: Color
    texture: int | None = None
    portals: tuple[Portal, ...] = ()

# SPDX-License-Identifier: Apache-2.0
"""The kinds of lights, one entry each, and the registry that other packages add theirs to.

An entry names a subclass of `Light` and says how its row of the light table and its node of the light tree are filled.
The kernels of a kind (sampling, density, intersection, emission) are in the module of `tiscene.render.lights` that has
the kind's name, or are passed to `tiscene.render.lights.light_kernels.register_light` together with an entry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.scene.description import (
    Color,
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    Light,
    RectLight,
    SphereLight,
)

# Rows of the light table are sorted by these: finite lights that rays can hit, points, lights at infinity.
AREA, POSITIONAL, AT_INFINITY, SURROUNDING, SPECIAL = range(5)

Triple = tuple[float, float, float]
_ZERO: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class LightShape:
    """Size, importance and extent of a light that has a position.

    Attributes:
        sizes: At most two numbers, m, that the kernels of the kind read from columns SIZE and SIZE + 1 of its row.
        strength: About d² times the irradiance (luminance, W/m²) at a large distance d in the direction of strongest
            emission; the importance of the light is proportional to it. Any positive value is correct.
        flat: Whether the light emits from one side, towards its -z; else towards all sides.
        size2: About the mean squared distance, m², of the light's points from its center; bounds the importance nearby.
        box: Half extents, m, along the light's axes. The light's points lie in the sum of this box and `ellipsoid`.
        ellipsoid: Semi-axes, m, along the light's axes.
    """

    sizes: tuple[float, ...]
    strength: float
    flat: bool
    size2: float
    box: Triple = _ZERO
    ellipsoid: Triple = _ZERO


@dataclass(frozen=True, eq=False)
class UsdLightInputs:
    """A UsdLux prim as the USD reader hands it to the reader of a registered kind.

    The prim has the API schema LightAPI. USD ignores transforms on prims of types unknown to it: its parent is placed.

    Attributes:
        name: Name of the prim.
        prim_path: Its path.
        world_from_light: float64 [4, 4], rigid, m.
        emission: Linear Rec.709, intensity · 2^exposure · color, before `normalize`, W/m²/sr.
        scale: Factors of lengths along the light's axes, without the stage's unit.
        meters_per_unit: The stage's unit.
        value: `value(name, default)` reads `inputs:<name>` of the prim at the time that is read.
    """

    name: str
    prim_path: str
    world_from_light: NDArray[np.float64]
    emission: Color
    scale: tuple[float, float, float]
    meters_per_unit: float
    value: Callable[[str, Any], Any]


@dataclass(frozen=True, eq=False)
class LightKind:
    """One kind of light.

    Attributes:
        name: Unique. Of a built-in kind also the module of its kernels.
        light: Subclass of `Light` with a field `radiance`; None for what no description holds.
        group: AREA for lights that rays can hit; built-in kinds also POSITIONAL, AT_INFINITY, SURROUNDING, SPECIAL.
        shape: `shape(light, luminance)`, of AREA and POSITIONAL kinds. luminance: of the radiance, averaged over the
            light's texture.
        accepts: Which instances of `light` are of this kind; None: all.
        usd: Of registered kinds, by the type name of a USD prim the function that makes a light of it; None from it
            means that the prim gives no light.
    """

    name: str
    light: type[Light] | None
    group: int = AREA
    shape: Callable[[Any, float], LightShape] | None = None
    accepts: Callable[[Any], bool] | None = None
    usd: Mapping[str, Callable[[UsdLightInputs], Light | None]] = field(default_factory=dict)


def _rect(light: RectLight, luminance: float) -> LightShape:
    area = light.width * light.height
    half = (0.5 * light.width, 0.5 * light.height, 0.0)
    return LightShape((light.width, light.height), area * luminance, True, area / (2.0 * math.pi), box=half)


def _disk(light: DiskLight, luminance: float) -> LightShape:
    radius = light.radius
    strength = math.pi * radius**2 * luminance
    return LightShape((radius,), strength, True, 0.5 * radius**2, ellipsoid=(radius, radius, 0.0))


def _sphere(light: SphereLight, luminance: float) -> LightShape:
    radius = light.radius
    strength = math.pi * radius**2 * luminance
    return LightShape((radius,), strength, False, 0.25 * radius**2, ellipsoid=(radius, radius, radius))


def _cylinder(light: CylinderLight, luminance: float) -> LightShape:
    radius, length = light.radius, light.length
    size2 = 0.25 * max(radius, length) ** 2
    strength = 2.0 * radius * length * luminance
    return LightShape((radius, length), strength, False, size2, (0.5 * length, 0.0, 0.0), (0.0, radius, radius))


def _point(light: SphereLight, luminance: float) -> LightShape:
    return LightShape((0.0,), luminance, False, 0.0)


# The index of an entry is the light table's KIND. Registered kinds are appended.
LIGHT_KINDS = [
    LightKind("rect", RectLight, AREA, _rect),
    LightKind("disk", DiskLight, AREA, _disk),
    LightKind("sphere", SphereLight, AREA, _sphere),
    LightKind("cylinder", CylinderLight, AREA, _cylinder),
    LightKind("point", SphereLight, POSITIONAL, _point, accepts=lambda light: not light.radius > 0.0),
    LightKind("distant", DistantLight, AT_INFINITY),
    LightKind("dome", DomeLight, SURROUNDING),
    LightKind("portal", None, SPECIAL),  # a dome's, sampled like a light of its own
    LightKind("mesh", None, SPECIAL),  # an instance with emissive triangles
]
BUILT_IN_KINDS = len(LIGHT_KINDS)
RECT, DISK, SPHERE, CYLINDER, POINT, DISTANT, DOME, PORTAL, MESH = range(BUILT_IN_KINDS)

_tables_built = False


def kind_of(light: Light) -> int:
    """Return the index in `LIGHT_KINDS` of a light's kind.

    Raises:
        TypeError: No kind is registered for the light's class.
    """
    for code in reversed(range(len(LIGHT_KINDS))):
        kind = LIGHT_KINDS[code]
        if kind.light is not None and isinstance(light, kind.light) and (kind.accepts is None or kind.accepts(light)):
            return code
    raise TypeError(f"{light.prim_path}: no kind of light is registered for {type(light).__name__}")


def usd_reader(prim_type: str) -> Callable[[UsdLightInputs], Light | None] | None:
    """Return the function that reads prims of a USD type, from the registered kinds; None if no kind has that type."""
    return next((kind.usd[prim_type] for kind in LIGHT_KINDS if prim_type in kind.usd), None)


def add_kind(kind: LightKind) -> int:
    """Append an entry; returns its index.

    Raises:
        ArgumentError: The name is taken, the entry is no AREA light with a shape, or a light table was built before.
    """
    if any(kind.name == each.name for each in LIGHT_KINDS):
        raise ArgumentError(f"light kind {kind.name!r} is registered already")
    if kind.group != AREA or kind.shape is None or kind.light is None:
        raise ArgumentError(f"light kind {kind.name!r}: a registered kind needs light=, shape= and group=AREA")
    if _tables_built:
        raise ArgumentError(
            f"light kind {kind.name!r}: kernels without it may be compiled already; register it before the first scene"
            " is rendered in this process"
        )
    LIGHT_KINDS.append(kind)
    return len(LIGHT_KINDS) - 1


def remove_kind(name: str) -> int:
    """Remove the last registered entry, which must have that name; returns the index that it had.

    Raises:
        ArgumentError: The last entry is a built-in one or has another name.
    """
    if len(LIGHT_KINDS) == BUILT_IN_KINDS or LIGHT_KINDS[-1].name != name:
        raise ArgumentError(f"light kind {name!r} is not the one registered last")
    LIGHT_KINDS.pop()
    return len(LIGHT_KINDS)


def close_registry() -> None:
    """Refuse further kinds: from now on kernels that know those registered so far may be compiled."""
    global _tables_built
    _tables_built = True

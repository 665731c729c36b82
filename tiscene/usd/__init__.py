# SPDX-License-Identifier: Apache-2.0
"""USD files to scene descriptions and back: the only package that imports pxr.

::

    core         stages, reports, units, transforms, semantics, time samples, schema
    read         walk a stage: objects, instances, templates, cameras
    geometry     meshes, subdivision, gprims, curves, skinning
    materials    materials, shader networks, textures, images
    lights       UsdLux
    referencing  units and axes of stages that others reference
    joining      join: stages of several rooms
    scenario     scenarios and motion on a stage, both ways
    importers    glTF, OBJ and others to templates
"""

from __future__ import annotations

from typing import Any

from dynamics.lazy_names import import_name

_MODULES = {
    "Opening": "tiscene.usd.joining.floor_plan",
    "RoomPlacement": "tiscene.usd.joining.floor_plan",
    "join": "tiscene.usd.joining.room_join",
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    return import_name(__name__, _MODULES, name)


def __dir__() -> list[str]:
    return __all__

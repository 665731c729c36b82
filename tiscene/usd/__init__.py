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

from dynamics.lazy_names import lazy_names

_MODULES = {
    "tiscene.usd.joining.floor_plan": ("Opening", "RoomPlacement"),
    "tiscene.usd.joining.room_join": ("join",),
}
__getattr__, __dir__, __all__ = lazy_names(__name__, _MODULES)

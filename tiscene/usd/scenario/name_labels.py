# SPDX-License-Identifier: Apache-2.0
"""write_name_labels: categories that come from names, as labels of a baked layer.

Names are categories on a stage without labels alone. A layer that adds labeled objects to such a stage would lose them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from pxr import Usd, UsdGeom, UsdSemantics

from tiscene.scene.description import SceneObject
from tiscene.usd.core.semantics import PREFERRED_TAXONOMIES, direct_label, inherited_label, name_label, taxonomies_of
from tiscene.usd.core.stage import reading_time
from tiscene.usd.scenario.layer import OverLayer


def write_name_labels(over: OverLayer, spawned: Mapping[Usd.Prim, str], stage_objects: Iterable[SceneObject]) -> None:
    """Label the objects of a layer that have no label, where their names do not give their categories any more.

    Args:
        over: the layer.
        spawned: categories of the prims that the layer adds.
        stage_objects: the objects of the scene.
    """
    unlabeled = {prim: category for prim, category in spawned.items() if category and not _is_labeled(prim)}
    if not taxonomies_of(over.stage) and all(name_label(prim) == name for prim, name in unlabeled.items()):
        return
    for prim, category in unlabeled.items():
        _label(prim, category)
    scene = over.below
    if taxonomies_of(scene):
        return
    points = dict.fromkeys(each.prim_path.partition("[")[0] for each in stage_objects if "[" in each.prim_path)
    for instancer in points:
        for target in UsdGeom.PointInstancer(scene.GetPrimAtPath(instancer)).GetPrototypesRel().GetTargets():
            _label(over.editable(str(target)), name_label(scene.GetPrimAtPath(target)))
    for each in stage_objects:
        if "[" not in each.prim_path:
            _label(over.editable(each.prim_path), each.category)


def _is_labeled(prim: Usd.Prim) -> bool:
    time = reading_time(prim.GetStage(), None)
    if inherited_label(prim, time, None):
        return True
    return any(direct_label(each, time, None) for each in Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))


def _label(prim: Usd.Prim | None, category: str) -> None:
    if prim and category:
        UsdSemantics.LabelsAPI.Apply(prim, PREFERRED_TAXONOMIES[0]).CreateLabelsAttr([category])

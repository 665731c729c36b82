# SPDX-License-Identifier: Apache-2.0
"""Semantics of prims: labels, names of assets, and which prims are objects of their own.

Labels are those of UsdSemanticsLabelsAPI. On a prim without them, the ones of its predecessor in Omniverse are read:
SemanticsAPI, whose semanticType is the taxonomy and whose semanticData is the label.

An object is the nearest enclosing prim of kind `component`, else a native instance, else the gprim itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from pxr import Kind, Sdf, Usd, UsdGeom, UsdSemantics

from tiscene.errors import UnknownName
from tiscene.usd.core.package import split_package
from tiscene.usd.core.prims import ancestors, outermost_instance, with_ancestors

PREFERRED_TAXONOMIES = ("class", "category")
_TYPE, _DATA = ":params:semanticType", ":params:semanticData"  # ends of names of attributes of SemanticsAPI
_BLENDER_OBJECT = "userProperties:blender:object_name"  # attribute of objects that Blender exports
ROOM = "room"  # taxonomy of volumes of rooms, which are no objects


def direct_label(prim: Usd.Prim, time: Usd.TimeCode, taxonomy: str | None) -> str:
    """Return the label authored on a prim itself, "" for none.

    Args:
        prim: the prim.
        time: time code to read at.
        taxonomy: its first label is returned; None: that of `class`, else of `category`, else of the first other
            taxonomy by name.
    """
    labels = {}
    for name in _direct_taxonomies(prim):
        values = UsdSemantics.LabelsAPI(prim, name).GetLabelsAttr().Get(time)
        if values:
            labels[name] = str(values[0])
    labels = labels or _omniverse_labels(prim, time)
    if taxonomy is not None or not labels:
        return labels.get(taxonomy or "", "")
    preferred = [name for name in PREFERRED_TAXONOMIES if name in labels]
    return labels[preferred[0] if preferred else min(labels)]


def _direct_taxonomies(prim: Usd.Prim) -> list[str]:
    """Return the taxonomies of a prim's own UsdSemanticsLabelsAPI, without `ROOM`."""
    return [str(name) for name in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim) if name != ROOM]


def _omniverse_labels(prim: Usd.Prim, time: Usd.TimeCode) -> dict[str, str]:
    """Return the labels of Omniverse's SemanticsAPI on a prim, by taxonomy: that of the first instance of each.

    The schema is not registered with USD, so that its attributes are found by their names.
    """
    labels: dict[str, str] = {}
    for each in prim.GetAuthoredPropertiesInNamespace("semantic"):
        name = each.GetName()
        values = [prim.GetAttribute(name.removesuffix(_TYPE) + end) for end in (_TYPE, _DATA)]
        if name.endswith(_TYPE) and all(values):
            taxonomy, label = (value.Get(time) for value in values)
            if taxonomy and label:
                labels.setdefault(str(taxonomy), str(label))
    return labels


def inherited_label(prim: Usd.Prim, time: Usd.TimeCode, taxonomy: str | None) -> str:
    """Return the `direct_label` of a prim or of its nearest ancestor that has one, "" for none."""
    labels = (direct_label(each, time, taxonomy) for each in with_ancestors(prim))
    return next(filter(None, labels), "")


def taxonomies_of(stage: Usd.Stage) -> set[str]:
    """Return the taxonomies of all labels on a stage, those of prototypes and templates included, without `ROOM`."""
    found: set[str] = set()
    roots = [stage.GetPseudoRoot(), *stage.GetPrototypes()]
    for prim in (prim for root in roots for prim in Usd.PrimRange(root, Usd.PrimAllPrimsPredicate)):
        found.update(_direct_taxonomies(prim) or _omniverse_labels(prim, Usd.TimeCode.EarliestTime()))
    return found


def check_taxonomy(stage: Usd.Stage, taxonomy: str | None) -> None:
    """Raise UnknownName for a taxonomy that no label on the stage has. None is valid."""
    if taxonomy is None:
        return
    known = taxonomies_of(stage)
    if not isinstance(taxonomy, str) or taxonomy not in known:
        hint = "" if known else "Nothing on the stage has a semantic label."
        raise UnknownName("taxonomy", taxonomy, known, where=f" in {stage.GetRootLayer().GetDisplayName()}", hint=hint)


def name_label(prim: Usd.Prim) -> str:
    """Return a category derived from a prim's name, without a trailing number.

    It is the name of its asset, else of its object in Blender, else its own.
    """
    name = str(Usd.ModelAPI(prim).GetAssetName() or _blender_name(prim) or prim.GetName())
    return name.rstrip("0123456789").rstrip("_- .") or name


def object_name(prim: Usd.Prim) -> str:
    """Return the name of an object: that of its mesh's object in Blender, else its prim's, which no copy shares."""
    return (_blender_name(prim) if prim.IsA(UsdGeom.Gprim) else "") or str(prim.GetName())


def _blender_name(prim: Usd.Prim) -> str:
    """Return the name of a prim's object in Blender, "" for none.

    Blender writes an object as a transform and names the mesh below it by its data: "Cube" for whatever was made of a
    cube. Copies by instancing have numbers behind their names.
    """
    for each in (prim, prim.GetParent()) if prim.IsA(UsdGeom.Gprim) else (prim,):
        name = each.GetAttribute(_BLENDER_OBJECT)
        if name:
            return str(name.Get() or "")
    return ""


def asset_name(prim: Usd.Prim) -> str:
    """Return the name of the asset that a prim belongs to, "" for none.

    It is the name in the assetInfo of the nearest prim at or above it, or derived from the name of the file whose
    default prim that one references.
    """
    names = (Usd.ModelAPI(each).GetAssetName() or _name_of_reference(each) for each in with_ancestors(prim))
    return str(next(filter(None, names), ""))


def _name_of_reference(prim: Usd.Prim) -> str:
    if not (prim.HasAuthoredReferences() or prim.HasAuthoredPayloads()):
        return ""
    for spec in prim.GetPrimStack():
        for each in (*spec.referenceList.GetAppliedItems(), *spec.payloadList.GetAppliedItems()):
            if each.assetPath and (each.primPath.isEmpty or _is_default_prim(prim, each.primPath, spec.layer)):
                path = str(spec.layer.ComputeAbsolutePath(each.assetPath))
                return readable_name(Path(split_package(path)[-1]))
    return ""


def _is_default_prim(prim: Usd.Prim, path: Sdf.Path, referring: Sdf.Layer) -> bool:
    """Return whether a path that a layer refers to with its name is that of the other layer's default prim."""
    stack = ((spec.layer, spec.path) for spec in prim.GetPrimStack())
    return any(found == path == layer.GetDefaultPrimAsPath() and layer != referring for layer, found in stack)


def readable_name(path: Path) -> str:
    """Return a name derived from a file's: "Chair 01" for `chair_01.usda` and for `chair_01/template.usda`."""
    return spaced(path.resolve().parent.name if path.stem == "template" else path.stem)


def scene_name(path: Path) -> str:
    """Return the name of a scene from its file's: that of its folder for `room_02/scene.usda`."""
    return path.resolve().parent.name if path.stem == "scene" else path.stem


def spaced(name: str) -> str:
    """Return an identifier as words: "Chair 01" for "chair_01"."""
    return " ".join(word[:1].upper() + word[1:] for word in name.split("_") if word)


def is_component(prim: Usd.Prim) -> bool:
    """Return whether a prim's kind is `component` or derived from it: it is an object, with all prims below it."""
    return _is_of_kind(prim, Kind.Tokens.component)


def is_object_instance(prim: Usd.Prim) -> bool:
    """Return whether a prim is a native instance, and not of a kind that holds several objects (group, assembly)."""
    return bool(prim.IsInstance()) and not _is_of_kind(prim, Kind.Tokens.group)


def is_outermost_object(prim: Usd.Prim) -> bool:
    """Return whether a prim is an object, given that none of its ancestors is."""
    return is_component(prim) or is_object_instance(prim) or prim.IsA(UsdGeom.Gprim)


def uninstance(stage: Usd.Stage, find: Callable[[], Iterable[Usd.Prim]]) -> None:
    """Make the instances that are, or hold, some prims plain ones, so that these can be edited on their own.

    An instance that was an object of its own still is one: it becomes a component.

    Args:
        stage: the stage, whose edit target is edited.
        find: returns the prims; it is called until none of them is in an instance, since instances may hold others.
    """
    # In their order, not in one of a set: paths are hashed by their addresses, and the order is that of the layer.
    while instances := dict.fromkeys(found.GetPath() for prim in find() if (found := outermost_instance(prim))):
        for instance in map(stage.GetPrimAtPath, instances):
            in_object = any(is_component(above) or is_object_instance(above) for above in ancestors(instance))
            if is_object_instance(instance) and not in_object:
                Usd.ModelAPI(instance).SetKind(Kind.Tokens.component)
            instance.SetInstanceable(False)


def shared_path(prim: Usd.Prim) -> Sdf.Path:
    """Return the path that all instances of a prim share: that in its prototype."""
    return (prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath()


def _is_of_kind(prim: Usd.Prim, kind: str) -> bool:
    if not prim.HasAuthoredMetadata("kind"):
        return False
    return bool(Kind.Registry.IsA(str(prim.GetMetadata("kind")), kind))

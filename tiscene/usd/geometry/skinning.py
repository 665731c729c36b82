# SPDX-License-Identifier: Apache-2.0
"""UsdSkel: bake the skinning of a stage into its session layer.

Meshes bound to skeletons get skinned points and normals as ordinary attributes, so that the other readers need to know
nothing about skeletons. USD computes the skinning: linear blend or dual quaternions, and blend shapes.
"""

from __future__ import annotations

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import dense_times

_TRAVERSAL = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)
_MAX_TIME_CODES = 10_000_000  # of a stage; USD visits each of them, in about a microsecond


def bake_skinning(stage: Usd.Stage, time: Usd.TimeCode, report: StageReport) -> None:
    """Author the skinned points and normals of every SkelRoot in the session layer; no file changes.

    Instances that contain a SkelRoot stop being instances, because each may have another pose.

    Args:
        stage: the stage to change.
        time: the time code to pose it at, if it does not play.
        report: says whether the stage plays, in which case time samples are authored; collects what stays unposed.
    """
    session = stage.GetSessionLayer()
    if _skel_roots(stage):  # BakeSkinning writes the stage's time codes into the layer unscaled
        session.timeCodesPerSecond = stage.GetRootLayer().timeCodesPerSecond
    with Usd.EditContext(stage, session):
        while instances := _instances_with_skeletons(stage):
            for prim in instances:
                prim.SetInstanceable(False)
        everything = report.reads_animation or time.IsEarliestTime()
        interval = Gf.Interval.GetFullInterval() if everything else Gf.Interval(time.GetValue())
        length = stage.GetEndTimeCode() - stage.GetStartTimeCode()
        for prim in _skel_roots(stage):
            if length > _MAX_TIME_CODES:
                text = f"a SkelRoot on a stage of {length:.3g} time codes (limit {_MAX_TIME_CODES:g}) is drawn unposed"
                report.omission(prim.GetPath(), text)
                continue
            root = UsdSkel.Root(prim)
            _author_samples(root, time, report.reads_animation)
            if not UsdSkel.BakeSkinning(root, interval):
                report.omission(prim.GetPath(), "a SkelRoot whose skinning USD cannot compute is drawn unposed")


def is_unskinned(prim: Usd.Prim) -> bool:
    """Return whether a gprim is bound to a skeleton, but `bake_skinning` has not posed it."""
    if not UsdSkel.BindingAPI(prim).GetJointIndicesPrimvar().HasAuthoredValue():
        return False
    points = prim.GetPath().AppendProperty(UsdGeom.Tokens.points)
    return prim.GetStage().GetSessionLayer().GetAttributeAtPath(points) is None


def _skel_roots(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), _TRAVERSAL) if prim.IsA(UsdSkel.Root)]


def _instances_with_skeletons(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return the outermost instances that contain a SkelRoot, are one, or are inside one."""
    found: dict[Sdf.Path, Usd.Prim] = {}
    for root in _skel_roots(stage):
        inner = [prim for prim in Usd.PrimRange(root, _TRAVERSAL) if prim.IsInstance()]
        outer = root
        while outer and not outer.IsPseudoRoot():
            inner += [outer] if outer.IsInstance() else []
            outer = outer.GetParent()
        found |= {prim.GetPath(): prim for prim in inner if not prim.IsInstanceProxy()}
    return list(found.values())


def _author_samples(root: UsdSkel.Root, time: Usd.TimeCode, plays: bool) -> None:
    """Author samples of the animations below a root at the times at which USD shall pose it.

    BakeSkinning evaluates at authored samples only, and skinned points are interpolated linearly while joints rotate.
    A stage that plays therefore gets a sample at every time code, another one at `time`.
    """
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    done = set()
    for binding in cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate):
        query = cache.GetSkelQuery(binding.GetSkeleton()).GetAnimQuery()
        if not query or query.GetPrim().GetPath() in done:
            continue
        done.add(query.GetPrim().GetPath())
        for name in ("translations", "rotations", "scales", "blendShapeWeights"):
            attribute = query.GetPrim().GetAttribute(name)
            if not attribute.ValueMightBeTimeVarying():
                continue
            static = [] if time.IsEarliestTime() else [time.GetValue()]
            times = dense_times(attribute.GetTimeSamples()) if plays else static
            values = [
                (each, attribute.Get(each)) for each in times
            ]  # read all first: authored samples hide those of weaker layers
            for each, value in values:
                attribute.Set(value, each)

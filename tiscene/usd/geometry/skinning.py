# SPDX-License-Identifier: Apache-2.0
"""UsdSkel: meshes bound to skeletons get the points that their skinning gives them, on the stage itself."""

from __future__ import annotations

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import filled

_EVERYTHING = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)
_LONGEST = 10_000_000  # time codes of a stage: USD counts through them all, in a microsecond each


def bake_skinning(stage: Usd.Stage, time: Usd.TimeCode, report: StageReport) -> None:
    """Author the skinned points and normals of every SkelRoot in the session layer: no file is changed.

    As time samples if the stage plays, else those of one time. Instances that hold a SkelRoot become ordinary prims,
    for each may have another pose. Skinning goes by USD's own rules: linear blend or dual quaternions, blend shapes.
    """
    session = stage.GetSessionLayer()
    if _skel_roots(stage):  # USD bakes into a layer as if its time codes were the stage's own
        session.timeCodesPerSecond = stage.GetRootLayer().timeCodesPerSecond
    with Usd.EditContext(stage, session):
        while instances := _instances_about_skeletons(stage):
            for prim in instances:
                prim.SetInstanceable(False)
        everything = report.plays or time.IsEarliestTime()
        interval = Gf.Interval.GetFullInterval() if everything else Gf.Interval(time.GetValue())
        length = stage.GetEndTimeCode() - stage.GetStartTimeCode()
        for prim in _skel_roots(stage):
            if length > _LONGEST:
                report.omission(prim.GetPath(), f"a SkelRoot of a stage of {length:.3g} time codes is drawn unposed")
                continue
            root = UsdSkel.Root(prim)
            _sample(root, time, report.plays)
            if not UsdSkel.BakeSkinning(root, interval):
                report.omission(prim.GetPath(), "a SkelRoot whose skinning USD cannot compute is drawn unposed")


def is_unskinned(prim: Usd.Prim) -> bool:
    """Whether a gprim is bound to a skeleton, but has not been posed by it."""
    if not UsdSkel.BindingAPI(prim).GetJointIndicesPrimvar().HasAuthoredValue():
        return False
    points = prim.GetPath().AppendProperty(UsdGeom.Tokens.points)
    return prim.GetStage().GetSessionLayer().GetAttributeAtPath(points) is None


def _skel_roots(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), _EVERYTHING) if prim.IsA(UsdSkel.Root)]


def _instances_about_skeletons(stage: Usd.Stage) -> list[Usd.Prim]:
    """The outermost instances that hold a SkelRoot, are one, or lie in one."""
    found: dict[Sdf.Path, Usd.Prim] = {}
    for root in _skel_roots(stage):
        inner = [prim for prim in Usd.PrimRange(root, _EVERYTHING) if prim.IsInstance()]
        outer = root
        while outer and not outer.IsPseudoRoot():
            inner += [outer] if outer.IsInstance() else []
            outer = outer.GetParent()
        found |= {prim.GetPath(): prim for prim in inner if not prim.IsInstanceProxy()}
    return list(found.values())


def _sample(root: UsdSkel.Root, time: Usd.TimeCode, plays: bool) -> None:
    """Make samples of the animations below a root at whatever time USD is to pose it: it does so at samples only.

    That is at every time code, since a skin goes straight from one to the next, while its joints turn; or at one time.
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
            times = filled(attribute.GetTimeSamples()) if plays else [] if time.IsEarliestTime() else [time.GetValue()]
            values = [(each, attribute.Get(each)) for each in times]  # all, before the first hides the others
            for each, value in values:
                attribute.Set(value, each)

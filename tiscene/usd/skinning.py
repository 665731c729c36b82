"""UsdSkel: meshes bound to skeletons get the points that their skinning gives them, on the stage itself."""

from __future__ import annotations

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from tiscene.usd.problems import Report

_EVERYTHING = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)


def bake_skinning(stage: Usd.Stage, time: Usd.TimeCode, report: Report) -> None:
    """Author the skinned points and normals of every SkelRoot at a time in the session layer: no file is changed.

    Instances that hold one become ordinary prims, for each may have another pose. Skinning goes by USD's own rules:
    linear blend or dual quaternions, and blend shapes.
    """
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        while instances := _instances_about_skeletons(stage):
            for prim in instances:
                prim.SetInstanceable(False)
        interval = Gf.Interval.GetFullInterval() if time.IsEarliestTime() else Gf.Interval(time.GetValue())
        for prim in _skel_roots(stage):
            root = UsdSkel.Root(prim)
            path, animated = prim.GetPath(), _hold(root, time)
            if not UsdSkel.BakeSkinning(root, interval):
                report.omission(path, "a SkelRoot whose skinning USD cannot compute is drawn unposed")
            elif animated:
                report.frozen(path, "the pose of a skeleton")


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


def _hold(root: UsdSkel.Root, time: Usd.TimeCode) -> bool:
    """Make a moment a sample of the animations below a root, for USD poses at samples only. Whether there are any."""
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    animated = False
    for binding in cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate):
        query = cache.GetSkelQuery(binding.GetSkeleton()).GetAnimQuery()
        if query and (query.JointTransformsMightBeTimeVarying() or query.BlendShapeWeightsMightBeTimeVarying()):
            animated = True
            for name in ("translations", "rotations", "scales", "blendShapeWeights"):
                attribute = query.GetPrim().GetAttribute(name)
                if attribute.ValueMightBeTimeVarying() and not time.IsEarliestTime():
                    attribute.Set(attribute.Get(time), time)
    return animated

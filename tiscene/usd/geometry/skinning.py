# SPDX-License-Identifier: Apache-2.0
"""UsdSkel: what moves the points of skinned meshes, and baked samples of everything else that is skinned.

Meshes with linear blend skinning or blend shapes get a `Skin`, from which their vertices are computed when a frame is
asked for. Of rigidly bound prims without blend shapes, dual quaternion skinning and other gprims, USD computes the
samples, which are authored in the session layer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt

from tiscene.scene.skinned_deformation import BlendShapes, SkeletonPoses, Skin
from tiscene.usd.core.content import content_digest
from tiscene.usd.core.prims import DEFINED, ancestors, with_ancestors
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import shared_path, uninstance
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.core.transform import range_fault
from tiscene.usd.core.value_times import dense_times, transform_times
from tiscene.usd.geometry.primvar import outside

_AFFINE = np.eye(4)[:3]


def prepare_skinning(stage: Usd.Stage, time: Usd.TimeCode, report: StageReport) -> None:
    """Find the skins of a stage (`report.budget.skins`, by prim path) and bake what has none; no file changes.

    Instances that contain a prim to bake stop being instances, because each may have another pose.

    Args:
        stage: the stage to change.
        time: the time code to pose it at, if it does not play.
        report: says whether the stage plays; receives the skins, and what stays unposed.
    """
    if not _skel_roots(stage):
        return
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        uninstance(stage, lambda: filter(Usd.Prim.IsInstanceProxy, map(stage.GetPrimAtPath, baked_paths(stage))))
    reader = _SkinReader(stage, time, report)
    for root in _skel_roots(stage):
        with report.guard(root.GetPath()):
            reader.read(UsdSkel.Root(root))


def baked_paths(stage: Usd.Stage) -> set[Sdf.Path]:
    """Return the paths of the prims that `prepare_skinning` bakes."""
    queries = (query for root in _skel_roots(stage) for _, query in _bindings(UsdSkel.Root(root)))
    return {query.GetPrim().GetPath() for query in queries if not _is_on_demand(query)}


def skin_of(prim: Usd.Prim, report: StageReport) -> Skin | None:
    """Return what moves the points of a mesh; None if it is not skinned, or not posed."""
    found: Skin | None = report.budget.skins.get(prim.GetPath())
    return found


def report_unskinned(prim: Usd.Prim, report: StageReport) -> None:
    """Report a gprim with joints or blend shapes that `prepare_skinning` has not posed."""
    has_joints = UsdSkel.BindingAPI(prim).GetJointIndicesPrimvar().HasAuthoredValue()
    if not (has_joints or UsdSkel.BindingAPI(prim).GetBlendShapeTargetsRel().HasAuthoredTargets()):
        return
    if prim.GetPath() in report.budget.skins or prim.GetPath() in report.budget.baked_skins:
        return
    what = "joints is drawn without its skinning" if has_joints else "blend shapes is drawn without them"
    report.omission(prim.GetPath(), f"a mesh with {what}, since {_why_unskinned(prim)}")


def _why_unskinned(prim: Usd.Prim) -> str:
    if not any(each.IsA(UsdSkel.Root) for each in ancestors(prim)):
        return "it is not below a SkelRoot"
    relationships = (UsdSkel.BindingAPI(each).GetSkeletonRel() for each in with_ancestors(prim))
    bound = next((each for each in relationships if each and each.HasAuthoredTargets()), None)
    targets = [] if bound is None else bound.GetForwardedTargets()
    if not targets:
        return "neither it nor a prim above it has a skel:skeleton"
    skeleton = prim.GetStage().GetPrimAtPath(targets[0])
    if not skeleton or not skeleton.IsA(UsdSkel.Skeleton):
        return f"there is no Skeleton at its skel:skeleton <{targets[0]}>"
    return "its joints do not fit its skeleton, or SkelBindingAPI is not applied"


def _skel_roots(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), DEFINED) if prim.IsA(UsdSkel.Root)]


def _bindings(root: UsdSkel.Root) -> Iterator[tuple[UsdSkel.SkeletonQuery, UsdSkel.SkinningQuery]]:
    """Yield the skinned prims below a SkelRoot with their skeletons."""
    cache = UsdSkel.Cache()
    cache.Populate(root, DEFINED)
    for binding in cache.ComputeSkelBindings(root, DEFINED):
        skeleton = cache.GetSkelQuery(binding.GetSkeleton())
        if skeleton:
            for query in binding.GetSkinningTargets():
                yield skeleton, query


def _is_on_demand(query: UsdSkel.SkinningQuery) -> bool:
    """Return whether a skinned prim gets a `Skin`."""
    if not query.GetPrim().IsA(UsdGeom.Mesh):
        return False
    if not query.HasJointInfluences():
        return bool(query.HasBlendShapes())
    if query.IsRigidlyDeformed():
        mapper = query.GetBlendShapeMapper()
        return mapper is not None and not mapper.IsNull()  # else its transform alone moves it
    return bool(query.GetSkinningMethod() != UsdSkel.Tokens.dualQuaternion)


class _SkinReader:
    """Reads the skins of one stage. Prims of one prototype, and meshes of one skeleton, share arrays."""

    def __init__(self, stage: Usd.Stage, time: Usd.TimeCode, report: StageReport) -> None:
        self._stage = stage
        self._time = time
        self._report = report
        self._poses: dict[Any, SkeletonPoses] = {}
        self._skins: dict[Any, Skin | None] = {}

    def read(self, root: UsdSkel.Root) -> None:
        """Read or bake all skinned prims below a SkelRoot."""
        for skeleton, query in _bindings(root):
            prim = query.GetPrim()
            times = self._times(skeleton, query)
            with self._report.guard(prim):
                if not _is_on_demand(query):
                    self._bake(skeleton, query, times)
                    continue
                frames = self._mesh_from_skeleton(skeleton, prim, times)
                key = shared_path(prim), self._pose_key(skeleton, times), frames.tobytes()
                if key not in self._skins:
                    self._skins[key] = self._skin(skeleton, query, times, frames)
                skin = self._skins[key]
                if skin is not None:
                    self._report.budget.skins[prim.GetPath()] = skin

    def _times(self, skeleton: UsdSkel.SkeletonQuery, query: UsdSkel.SkinningQuery) -> list[float]:
        """Return the time codes at which a prim is posed; empty for the one that is read.

        Joints rotate between their samples, but vertices are interpolated linearly: every step is sampled.
        """
        if not self._report.reads_animation:
            return []
        times: set[float] = set()
        animation = skeleton.GetAnimQuery()
        if animation:
            times.update(animation.GetJointTransformTimeSamples())
            times.update(animation.GetBlendShapeWeightTimeSamples())
        for prim in _between(query.GetPrim(), skeleton.GetPrim()):
            times.update(transform_times(UsdGeom.Xformable(prim)) if prim.IsA(UsdGeom.Xformable) else ())
        return dense_times(times, self._stage) if len(times) > 1 else []

    def _codes(self, times: Sequence[float]) -> list[Usd.TimeCode]:
        return [Usd.TimeCode(time) for time in times] or [self._time]

    def _pose_key(self, skeleton: UsdSkel.SkeletonQuery, times: Sequence[float]) -> Any:
        animation = skeleton.GetAnimQuery()
        return shared_path(skeleton.GetPrim()), shared_path(animation.GetPrim()) if animation else None, tuple(times)

    def _poses_of(self, skeleton: UsdSkel.SkeletonQuery, times: Sequence[float]) -> SkeletonPoses | None:
        """Return the poses of a skeleton; None if USD cannot compute them."""
        key = self._pose_key(skeleton, times)
        if key not in self._poses:
            rows = [_matrices(skeleton.ComputeSkinningTransforms(code)) for code in self._codes(times)]
            count = len(skeleton.GetJointOrder())
            if not count or any(len(row) != count for row in rows):
                return None
            still = np.broadcast_to(_AFFINE, (len(rows), 1, 3, 4))
            seconds = in_seconds(self._stage, times) if times else np.zeros(1)
            transforms = np.concatenate([np.array(rows).reshape(-1, count, 3, 4), still], axis=1)
            if not np.isfinite(transforms).all():
                return None
            content = content_digest((seconds, transforms))
            self._poses[key] = self._poses.setdefault(content, SkeletonPoses(seconds, transforms))
        return self._poses[key]

    def _mesh_from_skeleton(
        self, skeleton: UsdSkel.SkeletonQuery, prim: Usd.Prim, times: Sequence[float]
    ) -> NDArray[np.float64]:
        """Return the transform from the skeleton's space to the mesh's, [1 or s, 3, 4]."""
        between = _between(prim, skeleton.GetPrim())
        moves = any(
            each.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(each).TransformMightBeTimeVarying() for each in between
        )
        codes = self._codes(times) if moves else self._codes(times)[:1]
        return np.concatenate([_matrices([_skeleton_to_prim(skeleton, prim, code)]) for code in codes])

    def _skin(
        self,
        skeleton: UsdSkel.SkeletonQuery,
        query: UsdSkel.SkinningQuery,
        times: Sequence[float],
        frames: NDArray[np.float64],
    ) -> Skin | None:
        prim = query.GetPrim()
        points = np.asarray(UsdGeom.Mesh(prim).GetPointsAttr().Get(self._time) or (), np.float64).reshape(-1, 3)
        poses = self._poses_of(skeleton, times)
        if poses is None:
            self._report.omission(prim.GetPath(), "a mesh whose skeleton USD cannot pose is drawn unposed")
            return None
        joints = weights = None
        bind = _AFFINE
        if query.HasJointInfluences():
            influences = query.ComputeVaryingJointInfluences(len(points), self._time)
            found, weights_found = influences or ((), ())  # None where their numbers do not match the points'
            joints = np.asarray(found, np.int64).reshape(len(points), -1) if len(points) else np.zeros((0, 1), np.int64)
            weights = np.asarray(weights_found, np.float64).reshape(joints.shape)
            order, own = list(skeleton.GetJointOrder()), query.GetJointOrder()
            count = len(order if own is None else own)
            if joints.size == 0 or joints.min() < 0 or joints.max() >= count or not np.isfinite(weights).all():
                text = "its joint indices and weights do not match its points and joints; it is drawn unposed"
                self._report.problem(prim.GetPath(), "skinning", text)
                return None
            if own is not None:
                number = {name: row for row, name in enumerate(order)}
                joints = np.array([number.get(name, len(order)) for name in own])[joints]
            bind = _matrices([query.GetGeomBindTransform(self._time)])[0]
        if not self._is_in_range(prim, np.concatenate([frames, bind[None]])):
            return None
        shapes = self._shapes(skeleton, query, times, len(points)) if query.HasBlendShapes() else None
        indices = None if joints is None else joints.astype(np.int32)
        return Skin(poses, points, None, None, indices, weights, bind, frames, shapes)

    def _is_in_range(self, prim: Usd.Prim, matrices: NDArray[np.float64]) -> bool:
        """Return whether transforms between a skeleton and a prim are finite and not too large; others are reported."""
        fault = range_fault(matrices)
        if fault:
            text = f"{fault}, or its geomBindTransform or its skeleton's transform does; it is drawn unposed"
            self._report.problem(prim.GetPath(), "skinning", text)
        return not fault

    def _shapes(
        self, skeleton: UsdSkel.SkeletonQuery, query: UsdSkel.SkinningQuery, times: Sequence[float], points: int
    ) -> BlendShapes | None:
        """Return the blend shapes of a mesh with their weights; None if nothing animates them."""
        animation, mapper = skeleton.GetAnimQuery(), query.GetBlendShapeMapper()
        if not animation or mapper is None:
            return None
        blend = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(query.GetPrim()))
        moved, offsets = blend.ComputeBlendShapePointIndices(), blend.ComputeSubShapePointOffsets()
        shape, point, offset, normal_offset = [], [], [], []
        for number, each in enumerate(offsets):
            values = np.asarray(each, np.float32).reshape(-1, 3)
            chosen = moved[blend.GetBlendShapeIndex(number)]
            at = np.asarray(chosen, np.int64) if len(chosen) else np.arange(len(values))
            if len(values) and (len(at) != len(values) or outside(at, points) is not None):
                name = blend.GetBlendShape(blend.GetBlendShapeIndex(number)).GetPrim().GetName()
                text = f"blend shape {name!r} moves points that do not exist, or has another number of offsets"
                self._report.problem(query.GetPrim().GetPath(), "skinning", text)
                continue
            if len(values):
                shape.append(np.full(len(values), number, np.int32))
                point.append(at.astype(np.int32))
                offset.append(values)
                turned = _normal_offsets(blend, number)
                normal_offset.append(turned if len(turned) == len(values) else np.zeros_like(values))
        if not shape or not all(np.isfinite(each).all() for each in offset):
            return None
        codes = self._codes(times)
        weights = np.zeros((len(codes), blend.GetNumSubShapes()), np.float32)
        for row, code in enumerate(codes):
            remapped = mapper.Remap(Vt.FloatArray(animation.ComputeBlendShapeWeights(code)))
            values, _, sub_shapes = blend.ComputeSubShapeWeights(remapped)
            np.add.at(weights[row], np.asarray(sub_shapes, np.int64), np.asarray(values, np.float32))
        if not np.isfinite(weights).all():
            self._report.problem(query.GetPrim().GetPath(), "blend shapes", "a weight is not a finite number")
            return None
        turns = np.concatenate(normal_offset)
        used = turns if turns.any() and np.isfinite(turns).all() else None
        return BlendShapes(np.concatenate(shape), np.concatenate(point), np.concatenate(offset), weights, used)

    def _bake(self, skeleton: UsdSkel.SkeletonQuery, query: UsdSkel.SkinningQuery, times: Sequence[float]) -> None:
        """Author the skinned points of a prim, or the transform of a rigidly bound one."""
        prim = query.GetPrim()
        session = self._stage.GetSessionLayer()
        session.timeCodesPerSecond = self._stage.GetRootLayer().timeCodesPerSecond
        authored = {}
        shapes = None
        if query.HasBlendShapes():
            points = UsdGeom.PointBased(prim).GetPointsAttr().Get(self._time) or ()
            shapes = self._shapes(skeleton, query, times, len(points))
        for row, code in enumerate(self._codes(times)):
            pose = skeleton.ComputeSkinningTransforms(code)
            if query.IsRigidlyDeformed():
                local = query.ComputeSkinnedTransform(pose, code) * _skeleton_to_prim(skeleton, prim.GetParent(), code)
                authored[code] = local
            else:
                points = UsdGeom.PointBased(prim).GetPointsAttr().Get(code)
                if points and shapes is not None:
                    points = shapes.applied(np.asarray(points, np.float64), row)
                    points = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
                if points is None or not query.ComputeSkinnedPoints(pose, points, code):
                    self._report.omission(prim.GetPath(), "a prim whose skinning USD cannot compute is drawn unposed")
                    return
                matrix = _matrices([_skeleton_to_prim(skeleton, prim, code)])[0]
                if not self._is_in_range(prim, matrix):
                    return
                moved = np.asarray(points, np.float64) @ matrix[:, :3].T + matrix[:, 3]
                authored[code] = Vt.Vec3fArray.FromNumpy(moved.astype(np.float32))
        with Usd.EditContext(self._stage, session):
            if query.IsRigidlyDeformed():
                attribute = UsdGeom.Xformable(prim).MakeMatrixXform().GetAttr()
            else:
                attribute = UsdGeom.PointBased(prim).GetPointsAttr()
            for code, value in authored.items():
                attribute.Set(value, code if times else Usd.TimeCode.Default())
        self._report.budget.baked_skins.add(prim.GetPath())


def _normal_offsets(blend: UsdSkel.BlendShapeQuery, number: int) -> NDArray[np.float32]:
    """Return the normal offsets [n, 3] of a shape or an inbetween shape, by the number of its points' offsets."""
    between, shape = blend.GetInbetween(number), blend.GetBlendShape(blend.GetBlendShapeIndex(number))
    offsets = between.GetNormalOffsets() if between else UsdSkel.BlendShape(shape).GetNormalOffsetsAttr().Get()
    return np.asarray(offsets or (), np.float32).reshape(-1, 3)


def _in_one_space(skeleton: Usd.Prim, prim: Usd.Prim) -> tuple[Usd.Prim, Usd.Prim]:
    """Return a skeleton and a prim; both in the prototype if USD gives the skeleton there."""
    in_prototype = skeleton.IsInPrototype() and prim.IsInstanceProxy()
    return skeleton, prim.GetPrimInPrototype() if in_prototype else prim


def _between(prim: Usd.Prim, skeleton: Usd.Prim) -> list[Usd.Prim]:
    """Return a prim, its skeleton and their ancestors, except those that they share."""
    prim, other = reversed(_in_one_space(skeleton, prim))
    shared = prim.GetPath().GetCommonPrefix(other.GetPath())
    found = []
    for each in (prim, other):
        while each and each.GetPath() != shared:
            found.append(each)
            each = each.GetParent()
    return found


def _skeleton_to_prim(skeleton: UsdSkel.SkeletonQuery, prim: Usd.Prim, code: Usd.TimeCode) -> Any:
    """Return the matrix, for row vectors, from a skeleton's space to a prim's.

    Transforms above both are left out, so that instances of one prototype have the same bits.
    """
    cache = UsdGeom.XformCache(code)
    source, prim = _in_one_space(skeleton.GetPrim(), prim)
    ancestor = source.GetStage().GetPrimAtPath(source.GetPath().GetCommonPrefix(prim.GetPath()))
    (above, resets), (below, also_resets) = (cache.ComputeRelativeTransform(each, ancestor) for each in (source, prim))
    if resets or also_resets:
        above, below = (cache.GetLocalToWorldTransform(each) for each in (source, prim))
    return above * below.GetInverse()


def _matrices(matrices: Any) -> NDArray[np.float64]:
    """Return USD's matrices for row vectors as [n, 3, 4] for column vectors."""
    rows = np.asarray(matrices, np.float64).reshape(-1, 4, 4)
    return np.ascontiguousarray(rows.transpose(0, 2, 1)[:, :3])

# SPDX-License-Identifier: Apache-2.0
"""Author skinned characters: tubes around a chain of joints, with random rotations over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt


def author_character(
    path: Path,
    *,
    samples: int,
    meshes: int = 1,
    scheme: str = "none",
    joints: int = 12,
    rings: int = 24,
    sides: int = 16,
    spacing: int = 5,
    normals: bool = False,
    blend_shapes: bool = False,
) -> Path:
    """Write a stage of one SkelRoot, /Root, whose meshes /Root/Mesh_0, ... share a skeleton.

    Args:
        path: the file.
        samples: number of whole time codes of the animation.
        meshes: number of meshes.
        scheme: subdivision scheme.
        joints: joints of the chain.
        rings: rings of points of each mesh.
        sides: points of each ring.
        spacing: time codes between authored rotations.
        normals: whether to author normals.
        blend_shapes: whether each mesh has a blend shape with animated weight.

    Returns:
        The path.
    """
    random = np.random.default_rng(1)
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(samples - 1)
    stage.SetTimeCodesPerSecond(24)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    root = UsdSkel.Root.Define(stage, "/Root")
    stage.SetDefaultPrim(root.GetPrim())
    skeleton = UsdSkel.Skeleton.Define(stage, "/Root/Skeleton")
    names = ["/".join(f"j{row}" for row in range(count + 1)) for count in range(joints)]
    skeleton.CreateJointsAttr(names)
    bind = [Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(0, 10 * row, 0)) for row in range(joints)]
    skeleton.CreateBindTransformsAttr(bind)
    skeleton.CreateRestTransformsAttr(bind[:1] + bind[1:2] * (joints - 1))
    animation = UsdSkel.Animation.Define(stage, "/Root/Skeleton/Animation")
    animation.CreateJointsAttr(names)
    animation.CreateTranslationsAttr([Gf.Vec3f(0)] + [Gf.Vec3f(0, 10, 0)] * (joints - 1))
    animation.CreateScalesAttr([Gf.Vec3h(1, 1, 1)] * joints)
    rotations = animation.CreateRotationsAttr()
    times = sorted({*range(0, samples, spacing), samples - 1})
    for time in times:
        axes = random.normal(size=(joints, 3)) * 0.3
        angles = np.linalg.norm(axes, axis=1)
        parts = np.column_stack([np.cos(angles / 2), axes * (np.sin(angles / 2) / angles)[:, None]])
        rotations.Set(Vt.QuatfArray([Gf.Quatf(*each) for each in parts.tolist()]), time)
    UsdSkel.BindingAPI.Apply(root.GetPrim()).CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    if blend_shapes:
        animation.CreateBlendShapesAttr(["bulge"])
        weight = animation.CreateBlendShapeWeightsAttr()
        for time in times:
            weight.Set([float(random.uniform())], time)
    for number in range(meshes):
        mesh = UsdGeom.Mesh.Define(stage, f"/Root/Mesh_{number}")
        UsdGeom.XformCommonAPI(mesh).SetTranslate((3 + 20 * number, 1, 2))
        UsdGeom.XformCommonAPI(mesh).SetRotate((10, 20, 30))
        mesh.CreateSubdivisionSchemeAttr(scheme)
        angle, row = np.meshgrid(np.arange(sides) / sides * 2 * np.pi, np.arange(rings))
        around = (8 + number) * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1)
        around[..., 1] = row * 10 * (joints - 1) / (rings - 1)
        points = around.reshape(-1, 3).astype(np.float32)
        first = np.arange((rings - 1) * sides)
        beside = first - first % sides + (first + 1) % sides
        corners = np.stack([first, first + sides, beside + sides, beside], axis=-1)
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(first), 4, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners.reshape(-1).astype(np.int32)))
        if normals:
            outwards = points * np.float32([1, 0, 1]) / np.float32(8 + number)
            mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(outwards))
            mesh.SetNormalsInterpolation("vertex")
        height = points[:, 1] / 10
        lower = np.clip(height.astype(np.int32), 0, joints - 2)
        upper_weight = np.clip(height - lower, 0, 1).astype(np.float32)
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        indices = np.stack([lower, lower + 1], axis=-1).astype(np.int32).reshape(-1)
        weights = np.stack([1 - upper_weight, upper_weight], axis=-1).reshape(-1)
        binding.CreateJointIndicesPrimvar(False, 2).Set(Vt.IntArray.FromNumpy(indices))
        binding.CreateJointWeightsPrimvar(False, 2).Set(Vt.FloatArray.FromNumpy(weights))
        binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(1, -2, 0.5)))
        if blend_shapes:
            shape = UsdSkel.BlendShape.Define(stage, mesh.GetPath().AppendChild("Bulge"))
            offsets = random.normal(size=(20, 3)).astype(np.float32) * 3
            shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(offsets))
            shape.CreatePointIndicesAttr(list(range(100, 120)))
            if normals:
                turns = random.normal(size=(20, 3)).astype(np.float32) / 3
                shape.CreateNormalOffsetsAttr(Vt.Vec3fArray.FromNumpy(turns))
            binding.CreateBlendShapesAttr(["bulge"])
            binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    stage.Save()
    return path

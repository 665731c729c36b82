# SPDX-License-Identifier: Apache-2.0
"""From a USD file to the first labels: a mesh of half a million triangles; thousands of prims and point instances.

The first line includes the compilation of its kernels, unless they are in Taichi's cache.
"""

import tempfile
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

import tiscene as ts
from tests.benchmarks.timing import timed
from tiscene.usd.read.stage_reader import read_stage

SIDE = 501  # points along each side of the ground
OBJECTS, POINTS = 3430, 10_000


def ground(path: Path) -> None:
    """Write a wavy mesh of 500,000 triangles with normals and texture coordinates."""
    stage = Usd.Stage.CreateNew(str(path))
    y, x = np.mgrid[:SIDE, :SIDE]
    points = np.stack([x * 0.1, 4.0 * np.sin(x * 0.05) * np.cos(y * 0.04), y * 0.1], axis=-1).reshape(-1, 3)
    corner = (y[:-1, :-1] * SIDE + x[:-1, :-1]).reshape(-1)
    faces = np.stack([corner, corner + SIDE, corner + SIDE + 1, corner + 1], axis=-1).reshape(-1)
    mesh = UsdGeom.Mesh.Define(stage, "/Ground")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(corner), 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.tile(np.float32([0, 1, 0]), (len(points), 1))))
    uv = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    uv.Set(Vt.Vec2fArray.FromNumpy(points[:, ::2].astype(np.float32)))
    stage.Save()


def crowd(path: Path) -> None:
    """Write 7,000 prims, half of them meshes, and 10,000 points of an instancer."""
    stage, random = Usd.Stage.CreateNew(str(path)), np.random.default_rng(0)
    for number in range(OBJECTS):
        root = UsdGeom.Xform.Define(stage, f"/World/Group_{number % 70}/Object_{number}")
        Usd.ModelAPI(root.GetPrim()).SetKind("component")
        root.AddTranslateOp().Set(tuple(random.uniform(-50, 50, 3).tolist()))
        mesh = UsdGeom.Mesh.Define(stage, root.GetPath().AppendChild("Mesh"))
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(random.normal(size=(12, 3)).astype(np.float32)))
        mesh.CreateFaceVertexCountsAttr([4] * 6)
        mesh.CreateFaceVertexIndicesAttr(list(range(12)) * 2)
        mesh.CreateSubdivisionSchemeAttr("none")
    scatter = UsdGeom.PointInstancer.Define(stage, "/World/Scatter")
    prototypes = [UsdGeom.Sphere.Define(stage, "/World/Scatter/Ball"), UsdGeom.Cube.Define(stage, "/World/Scatter/Box")]
    scatter.CreatePrototypesRel().SetTargets([prototype.GetPath() for prototype in prototypes])
    scatter.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(random.integers(0, 2, POINTS).astype(np.int32)))
    positions = random.uniform(-50, 50, (POINTS, 3)).astype(np.float32)
    scatter.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(positions))
    stage.Save()


def main() -> None:
    """Print the table."""
    print(f"{'':10} {'read, s':>8} {'first labels, s':>16} {'CPU, s':>8}")
    with tempfile.TemporaryDirectory() as folder:
        for author in (ground, crowd):
            path = Path(folder, f"{author.__name__}.usdc")
            author(path)
            read, _, _ = timed(read_stage, path)
            wall, cpu, _ = timed(lambda path=path: ts.Stream(path, width=64, height=48, buffers=("instance",))[0])
            print(f"{author.__name__:10} {read:8.2f} {wall:16.2f} {cpu:8.2f}")


if __name__ == "__main__":
    main()

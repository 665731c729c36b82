# SPDX-License-Identifier: Apache-2.0
"""Reading of stages with many subdivision surfaces, within their triangle budget: time and peak memory.

"kitchen": 240 different objects, 276,000 cage faces. "chess": 32 objects, 400,000 cage faces. Each stage is read in a
process of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

STAGES = {"kitchen": (240, 46, 25), "chess": (32, 125, 100)}  # objects, faces around and along each of them
READ = """
import json, resource, sys, time, warnings
from tiscene.usd.read.stage_reader import read_stage
warnings.simplefilter("ignore")
began, cpu = time.perf_counter(), time.process_time()
stage = read_stage(sys.argv[1])
wall, cpu = time.perf_counter() - began, time.process_time() - cpu
triangles = sum(len(mesh.triangles) for mesh in stage.meshes)
print(json.dumps([triangles, wall, cpu, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20]))
"""


def vase(around: int, along: int, random: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return the points and the corners of the quadrilaterals of a rippled ball with open poles."""
    u, v = np.linspace(0, 2 * np.pi, around, endpoint=False)[:, None], np.linspace(0, np.pi, along + 1)
    radius = 0.1 * (1.0 + 0.15 * np.sin(random.integers(2, 6) * u + random.uniform(0, 6)) * np.sin(v))
    points = np.stack([radius * np.cos(u) * np.sin(v), 0.1 * np.cos(v) + 0.0 * u, radius * np.sin(u) * np.sin(v)], -1)
    first = np.arange(around)[:, None] * (along + 1) + np.arange(along)
    second = (np.arange(around)[:, None] + 1) % around * (along + 1) + np.arange(along)
    corners = np.stack([first, first + 1, second + 1, second], axis=-1)
    return points.reshape(-1, 3).astype(np.float32), corners.reshape(-1).astype(np.int32)


def author(path: Path, objects: int, around: int, along: int) -> None:
    """Write a stage of different objects with texture coordinates, and a camera."""
    stage, random = Usd.Stage.CreateNew(str(path)), np.random.default_rng(1)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for number in range(objects):
        points, corners = vase(around, along, random)
        mesh = UsdGeom.Mesh.Define(stage, f"/Room/Object_{number}")
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(corners) // 4, 4, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners))
        kind, interpolation = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        uv = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, interpolation)
        uv.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(points[corners][:, :2])))
        place = random.uniform(-2, 2, 3) * (1.0, 0.5, 1.0)
        UsdGeom.XformCommonAPI(mesh).SetTranslate(Gf.Vec3d(*place.tolist()))
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    UsdGeom.XformCommonAPI(camera).SetTranslate(Gf.Vec3d(0.0, 0.5, 3.5))
    stage.Save()


def main() -> None:
    """Print the table."""
    print(f"{'':10} {'cage faces':>11} {'triangles':>11} {'read, s':>8} {'CPU, s':>8} {'peak, GiB':>10}")
    with tempfile.TemporaryDirectory() as folder:
        for name, (objects, around, along) in STAGES.items():
            path = Path(folder, f"{name}.usdc")
            author(path, objects, around, along)
            done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=True)
            triangles, wall, cpu, peak = json.loads(done.stdout)
            faces = objects * around * along
            print(f"{name:10} {faces:11,} {triangles:11,} {wall:8.1f} {cpu:8.1f} {peak:10.2f}")


if __name__ == "__main__":
    main()

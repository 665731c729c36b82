# SPDX-License-Identifier: Apache-2.0
"""The triangle budget of a stage's subdivision surfaces: levels of refinement by what a picture resolves.

Each surface is refined until it looks smooth (`subdivision`). Where that takes more triangles than the budget, all
surfaces are refined to one size of triangle in the picture instead, the largest that fits. The picture is that of the
nearest camera of the stage; without cameras, one that shows the whole stage.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom

from tiscene.usd.core.content import content_digest
from tiscene.usd.core.prims import DRAWN_PURPOSES, distinct_prims
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import shared_path
from tiscene.usd.core.shown_prims import is_always_invisible
from tiscene.usd.core.transform import point_matrices
from tiscene.usd.geometry.primvar import Topology, array_of
from tiscene.usd.geometry.subdivision import MAX_LEVELS, smooth_levels

# Constant, and not by the memory of the machine: a frame must have the same bytes everywhere. Refining and placing as
# many takes about 2 GB and ten seconds.
DEFAULT_TRIANGLES = 3_000_000
_PICTURE_HEIGHT = 1080.0  # px, of the picture that levels are chosen for
_NEAREST = 0.05  # distance of a camera from a surface, in units of the surface's radius; nearer ones count as this far
_SMALLEST, _LARGEST = 1.0 / 64.0, 65536.0  # px, of the triangles that the budget is tried for
_SAMPLES = 512  # edges that the size of a mesh's faces is measured by


@dataclass
class _Cage:
    """A control mesh and the places where it is drawn. Copies of equal content are one.

    Attributes:
        paths: of the meshes, in their prototypes.
        faces: number of faces.
        corners: number of face corners; refining once gives as many quadrilaterals.
        levels: levels until the surface looks smooth.
        edge: median length of an edge, in its own space.
        center: middle of its bounding box.
        radius: half the diagonal of its bounding box.
        places: middle of the bounding box in the world, and scale, one per place.
    """

    faces: int
    corners: int
    levels: int
    edge: float
    center: Gf.Vec3d
    radius: float
    paths: list[Sdf.Path] = field(default_factory=list)
    places: list[tuple[NDArray[np.float64], float]] = field(default_factory=list)

    def triangles(self, levels: int) -> int:
        """Return how many triangles a number of levels gives."""
        return 2 * self.corners * 4 ** (levels - 1) if levels else max(self.corners - 2 * self.faces, 0)

    def levels_at(self, pixels: float, edge_pixels: float) -> int:
        """Return the levels at which an edge of `edge_pixels` is at most `pixels` long, at most those of smoothness."""
        needed = math.ceil(math.log2(max(edge_pixels / pixels, 1e-9)))
        return min(self.levels, max(0, needed))


def limit_subdivision(stage: Usd.Stage, time: Usd.TimeCode, budget: int, report: StageReport) -> None:
    """Set `report.budget.levels`: the most levels of each surface that is refined less than it takes to look smooth.

    Args:
        stage: the stage.
        time: time code to read at.
        budget: triangles of all subdivision surfaces together; instances and equal copies count once.
        report: gets the levels, and one omission for what was reduced.
    """
    corners = 0
    for mesh in _surfaces(stage, time):
        with report.guard(mesh.GetPrim()):
            corners += len(array_of(mesh.GetFaceVertexIndicesAttr(), time, np.int32))
    if 2 * corners * 4 ** (MAX_LEVELS - 1) <= budget:
        return
    cages, cameras = _cages(stage, time, report)
    wanted = sum(cage.triangles(cage.levels) for cage in cages)
    if wanted <= budget:
        return
    pixels = [_edge_pixels(cage, cameras, cages) for cage in cages]

    def levels_for(size: float) -> list[int]:
        return [cage.levels_at(size, edge) for cage, edge in zip(cages, pixels, strict=True)]

    def count(levels: list[int]) -> int:
        return sum(cage.triangles(each) for cage, each in zip(cages, levels, strict=True))

    low, high = math.log2(_SMALLEST), math.log2(_LARGEST)
    for _ in range(32):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if count(levels_for(2.0**middle)) > budget else (low, middle)
    chosen = levels_for(2.0**high)
    total = count(chosen)
    reduced = [(cage, levels) for cage, levels in zip(cages, chosen, strict=True) if levels < cage.levels]
    report.budget.levels = {path: levels for cage, levels in reduced for path in cage.paths}
    text = (
        f"{len(reduced)} of {len(cages)} different subdivision surfaces are refined less than smooth: {total:,} "
        f"instead of {wanted:,} triangles, edges of about {2.0**high:.2g} px in a picture {_PICTURE_HEIGHT:.0f} px "
        f"high (subdivision={budget:,})"
    )
    for cage, _ in sorted(reduced, key=lambda each: each[0].levels - each[1], reverse=True):
        report.omission(cage.paths[0], text)


def _surfaces(stage: Usd.Stage, time: Usd.TimeCode) -> Iterable[UsdGeom.Mesh]:
    """Yield the subdivision surfaces of a stage and of its prototypes, each once."""
    for prim in distinct_prims(stage):
        if prim.IsA(UsdGeom.Mesh) and _is_smooth(UsdGeom.Mesh(prim), time):
            yield UsdGeom.Mesh(prim)


def _is_smooth(mesh: UsdGeom.Mesh, time: Usd.TimeCode) -> bool:
    return mesh.GetSubdivisionSchemeAttr().Get(time) not in ("none", "bilinear")


def _cages(
    stage: Usd.Stage, time: Usd.TimeCode, report: StageReport
) -> tuple[list[_Cage], list[tuple[NDArray[np.float64], float]]]:
    """Return the different control meshes that are drawn, and each camera's place and focal length, px."""
    cages: dict[Sdf.Path, _Cage | None] = {}
    different: dict[bytes, _Cage] = {}
    cameras: list[tuple[NDArray[np.float64], float]] = []
    points: dict[Sdf.Path, NDArray[np.float64]] = {}  # matrices of the points of instancers, by prototype
    worlds = UsdGeom.XformCache(time)
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in prims:
        with report.guard(prim):
            if prim.IsA(UsdGeom.Imageable) and _is_hidden(UsdGeom.Imageable(prim), time):
                prims.PruneChildren()
            elif prim.IsA(UsdGeom.Camera):
                world = np.array(worlds.GetLocalToWorldTransform(prim)).T
                cameras.append((world[:3, 3], _focal_length(UsdGeom.Camera(prim), time)))
            elif prim.IsA(UsdGeom.PointInstancer):
                points |= _instancer_points(UsdGeom.PointInstancer(prim), time, worlds)
            elif prim.IsA(UsdGeom.Mesh) and _is_smooth(UsdGeom.Mesh(prim), time):
                path = shared_path(prim)
                if path not in cages:
                    cages[path] = _measure(UsdGeom.Mesh(prim), time, different)
                cage = cages[path]
                if cage is not None:
                    cage.paths += [] if path in cage.paths[-1:] else [path]
                    _place(cage, prim, worlds, points)
    return [cage for cage in different.values() if cage.places], cameras


def _is_hidden(imageable: UsdGeom.Imageable, time: Usd.TimeCode) -> bool:
    purpose = imageable.GetPurposeAttr()
    is_drawn = not purpose.HasAuthoredValue() or purpose.Get() in DRAWN_PURPOSES
    return not is_drawn or is_always_invisible(imageable, time)


def _focal_length(camera: UsdGeom.Camera, time: Usd.TimeCode) -> float:
    """Return a camera's focal length in the picture, px; that of a view of 60 degrees where it has none."""
    if camera.GetProjectionAttr().Get(time) != UsdGeom.Tokens.orthographic:
        focal, height = camera.GetFocalLengthAttr().Get(time), camera.GetVerticalApertureAttr().Get(time)
        if focal and height and focal > 0.0 and height > 0.0:
            return float(_PICTURE_HEIGHT * focal / height)
    return 0.5 * _PICTURE_HEIGHT / math.tan(math.radians(30.0))


def _instancer_points(
    instancer: UsdGeom.PointInstancer, time: Usd.TimeCode, worlds: UsdGeom.XformCache
) -> dict[Sdf.Path, NDArray[np.float64]]:
    """Return the world matrices [n, 4, 4] of an instancer's points, for each of its prototypes."""
    matrices = point_matrices(instancer, time)
    chosen = array_of(instancer.GetProtoIndicesAttr(), time, np.int64)
    if len(matrices) != len(chosen):
        return {}
    world = np.array(worlds.GetLocalToWorldTransform(instancer.GetPrim())).T
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    return {target: world @ matrices[chosen == number] for number, target in enumerate(targets)}


def _measure(mesh: UsdGeom.Mesh, time: Usd.TimeCode, different: dict[bytes, _Cage]) -> _Cage | None:
    """Return the size of a control mesh; None if it has no faces or contradicts itself.

    Args:
        mesh: the mesh.
        time: time code to read at.
        different: control meshes so far by content; added to.
    """
    points = array_of(mesh.GetPointsAttr(), time, np.float32, width=3)
    counts = array_of(mesh.GetFaceVertexCountsAttr(), time, np.int32)
    indices = array_of(mesh.GetFaceVertexIndicesAttr(), time, np.int32)
    topology = Topology(len(points), counts, indices)
    if not topology.is_consistent() or counts.min() < 3 or not np.isfinite(points).all():
        return None
    content = content_digest((points, counts, indices))
    if content in different:
        return different[content]
    inner = np.flatnonzero(np.diff(topology.face_of_corner) == 0)  # corners not the last of a face
    chosen = inner[:: max(1, len(inner) // _SAMPLES)]
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    edges = np.linalg.norm(points[indices[chosen + 1]].astype(np.float64) - points[indices[chosen]], axis=1)
    cage = _Cage(
        len(counts),
        len(indices),
        smooth_levels(points, topology),
        float(np.median(edges)),
        Gf.Vec3d(*(0.5 * (low + high)).tolist()),
        0.5 * float(np.linalg.norm(high - low)),
    )
    different[content] = cage
    return cage


def _place(
    cage: _Cage, prim: Usd.Prim, worlds: UsdGeom.XformCache, points: dict[Sdf.Path, NDArray[np.float64]]
) -> None:
    """Add the places of a mesh: its own, or those of the points that draw it."""
    root = next((target for target in points if prim.GetPath().HasPrefix(target)), None)
    matrix = worlds.GetLocalToWorldTransform(prim)
    matrices = np.array(matrix).T[None]
    if root is not None:
        parent = worlds.GetLocalToWorldTransform(prim.GetStage().GetPrimAtPath(root).GetParent())
        matrices = points[root] @ np.array(matrix * parent.GetInverse()).T
    scale = np.linalg.norm(matrices[:, :3, :3], axis=1).max(axis=1, initial=0.0)
    centers = matrices[:, :3, :3] @ np.array(cage.center) + matrices[:, :3, 3]
    kept = np.isfinite(centers).all(axis=1) & np.isfinite(scale)
    cage.places += list(zip(centers[kept], scale[kept].tolist(), strict=True))


def _edge_pixels(cage: _Cage, cameras: Sequence[tuple[NDArray[np.float64], float]], cages: Iterable[_Cage]) -> float:
    """Return the length of a cage's edges in the picture where it is largest, px."""
    centers = np.array([center for center, _ in cage.places])
    scale = np.array([scale for _, scale in cage.places])
    if not cameras:
        every = np.array([center for each in cages for center, _ in each.places])
        reach = max(scale * each.radius for each in cages for _, scale in each.places)
        extent = float(np.linalg.norm(np.ptp(every, axis=0))) + 2.0 * reach
        return float(scale.max()) * cage.edge / max(extent, 1e-30) * _PICTURE_HEIGHT
    nearest = np.maximum(_NEAREST * cage.radius * scale, 1e-30)
    sizes = [
        (
            scale * cage.edge * focal / np.maximum(np.linalg.norm(centers - at, axis=1) - cage.radius * scale, nearest)
        ).max()
        for at, focal in cameras
    ]
    return float(max(sizes))

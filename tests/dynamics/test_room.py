# SPDX-License-Identifier: Apache-2.0
"""Twenty movers in the living room for many frames: no penetration, no escape, no stall.

Embree tests the actual triangles of both sides for edges that pass through faces.
"""

import functools
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pxr", reason="the room is a USD stage")

import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from dynamics import Body, Mover, SteppedSimulation, UniformMovementRandomBounce, cover
from dynamics.contact import MAX_TOUCHES, TOUCH_COLUMNS
from dynamics.obstacles import Obstacles
from dynamics.rotation import matrix_from_quaternion
from dynamics.sweep_obstacles import obstacle_distances
from tests.dynamics.solids import spheres_at
from tiscene import catalog
from tiscene.scene.bvh.obstacle_tree import MeshTrees, ObstacleTree
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template

FPS = 25
COUNT = 20
TEMPLATES = [
    "Chair 01", "Torus", "Dish 01", "Pillow 01", "Tennis Racket 01", "Book 01", "Laptop 01", "Ball 01", "Cone",
    "Cup 01",
]  # fmt: skip


def merged(description: SceneDescription) -> trimesh.Trimesh:
    """Return all triangles of a stage or template as one mesh."""
    parts = [
        trimesh.Trimesh(description.meshes[each.mesh].positions, description.meshes[each.mesh].triangles, process=False)
        .apply_transform(each.world_from_object) for each in description.instances
    ]  # fmt: skip
    return trimesh.util.concatenate(parts)


def resident_memory() -> float:
    """Return the resident memory of this process, MB; 0 where it is unknown."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * 4096 / 1e6 if statm.exists() else 0.0


class RoomSimulation:
    def __init__(self, speed: float) -> None:
        self.stage = read_stage(catalog.find_scene("room_02"))
        # Its open windows have invisible colliders.
        self.whole = merged(replace(self.stage, instances=(*self.stage.instances, *self.stage.colliders)))
        self.rays = RayMeshIntersector(self.whole, scale_to_box=False)
        self.meshes = [merged(read_template(catalog.find_template(name)).description) for name in TEMPLATES]
        shapes = [cover(mesh.triangles) for mesh in self.meshes]
        trees = MeshTrees.built(self.stage.meshes)
        tree = ObstacleTree(trees, (*self.stage.instances, *self.stage.colliders))
        self.tree = Obstacles.from_trees(trees.bvh, trees.is_bvh8, tree.roots, tree.matrices, tree.root)
        random = np.random.default_rng(1)
        points = random.uniform(*self.stage.bounds(), (20_000, 3))
        free = self.distances(points, 1.0)
        order = np.argsort(-free)
        points, free = points[order], free[order]
        # Place the largest mover first, where the most space is.
        starts = np.zeros((COUNT, 3))
        reach = np.array([shapes[row % len(TEMPLATES)].reach for row in range(COUNT)])
        taken: list[int] = []
        for row in np.argsort(-reach).tolist():
            starts[row] = next(
                point
                for point, room in zip(points, free, strict=True)
                if room > reach[row] + 0.01
                and all(np.linalg.norm(point - starts[each]) > reach[row] + reach[each] for each in taken)
                and self.is_inside(point)
            )
            taken.append(row)
        movers = []
        for row, start in enumerate(starts):
            dynamic = UniformMovementRandomBounce(speed, 2.0, tuple(random.normal(size=3)), seed=32)
            movers.append(Mover(Body(dynamic, tuple(start.tolist()), name=f"m{row}"), shapes[row % len(TEMPLATES)]))
        self.simulation = SteppedSimulation(movers, fps=FPS, obstacles=lambda _frame: self.tree)
        self.movers = [RayMeshIntersector(mesh, scale_to_box=False) for mesh in self.meshes]

    @functools.cached_property
    def ends(self) -> list[np.ndarray]:
        """Both ends of the edges of the room."""
        return [self.whole.vertices[self.whole.edges_unique[:, side]] for side in (0, 1)]

    def distances(self, points: np.ndarray, limit: float) -> np.ndarray:
        table = np.zeros((len(points), 4), np.float32)
        table[:, :3] = points
        obstacle_distances(table, limit, np.zeros((MAX_TOUCHES, TOUCH_COLUMNS), np.float32), *self.tree.arguments())
        return table[:, 3]

    def is_inside(self, point: np.ndarray) -> bool:
        """Return whether rays along all axes hit the room."""
        six = np.concatenate([np.eye(3), -np.eye(3)])
        return bool(self.rays.intersects_any(np.tile(point, (6, 1)), six).all())

    def room_gap(self, poses: np.ndarray) -> float:
        """Return the gap between all proxy spheres and the room, meters; check that they are within its bounds."""
        spheres = [spheres_at(mover.shape, pose) for mover, pose in zip(self.simulation.movers, poses, strict=True)]
        low, high = self.stage.bounds()
        for centers, radii in spheres:
            assert (centers - radii[:, None] > low).all()
            assert (centers + radii[:, None] < high).all()
        nearest = self.distances(np.concatenate([centers for centers, _ in spheres]), 0.2)
        return float((nearest - np.concatenate([radii for _, radii in spheres])).min())

    def mover_gap(self, poses: np.ndarray) -> float:
        """Return the gap between the proxy spheres of different movers, meters."""
        spheres = [spheres_at(mover.shape, pose) for mover, pose in zip(self.simulation.movers, poses, strict=True)]
        nearest = np.inf
        for row, (a, r) in enumerate(spheres):
            for other, (b, s) in enumerate(spheres[:row]):
                reach = sum(self.simulation.movers[each].shape.reach for each in (row, other))
                if np.linalg.norm(poses[row, :3] - poses[other, :3]) < reach:
                    gaps = np.linalg.norm(a[:, None] - b, axis=2) - r[:, None] - s
                    nearest = min(nearest, float(gaps.min()))
        return nearest

    def count_crossings(self, poses: np.ndarray) -> int:
        """Count edges of the room that pass through a mover's faces, and the reverse."""
        count = 0
        start, end = self.ends
        for row, pose in enumerate(poses):
            mesh, turn = self.meshes[row % len(TEMPLATES)], matrix_from_quaternion(pose[3:])
            corners = mesh.vertices @ turn.T + pose[:3]
            count += count_hits(self.rays, corners[mesh.edges_unique[:, 0]], corners[mesh.edges_unique[:, 1]])
            reach = np.linalg.norm(mesh.vertices, axis=1).max() + 0.5 * np.linalg.norm(end - start, axis=1)
            near = np.linalg.norm(0.5 * (start + end) - pose[:3], axis=1) < reach
            if near.any():
                own = [(side[near] - pose[:3]) @ turn for side in (start, end)]
                count += count_hits(self.movers[row % len(TEMPLATES)], *own)
        return count


def count_hits(rays: RayMeshIntersector, start: np.ndarray, end: np.ndarray) -> int:
    """Count line segments that hit the mesh."""
    length = np.linalg.norm(end - start, axis=1)
    start, end, length = start[length > 1e-9], end[length > 1e-9], length[length > 1e-9]
    where, which, _ = rays.intersects_location(start, (end - start) / length[:, None], multiple_hits=False)
    return int((np.linalg.norm(where - start[which], axis=1) < length[which]).sum()) if len(which) else 0


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "frames"), [(1.5, 10_000), (20.0, 200)])
def test_twenty_movers_neither_penetrate_nor_leave_nor_stall(speed, frames):
    room = RoomSimulation(speed)
    low, high = room.stage.bounds()
    still = np.zeros(COUNT)
    longest, took, before = 0.0, [], None
    least, settled = np.inf, 0.0
    for frame in range(frames):
        begun = time.perf_counter()
        state = room.simulation.frame(frame)
        took.append(time.perf_counter() - begun)
        poses = state.poses
        assert (poses[:, :3] > low).all(), f"frame {frame}: a mover has left the room"
        assert (poses[:, :3] < high).all(), f"frame {frame}: a mover has left the room"
        if frame % 10 == 0:
            least = min(least, room.room_gap(poses), room.mover_gap(poses))
            assert least > 0.0, f"frame {frame}"
        if frame % (frames // 10) == 0:
            assert room.count_crossings(poses) == 0, f"frame {frame}"
        if frame == frames // 2:
            settled = resident_memory()
        if before is not None:
            slow = np.linalg.norm(poses[:, :3] - before[:, :3], axis=1) < 0.1 * speed / FPS
            still = np.where(slow, still + 1, 0)
            longest = max(longest, still.max() / FPS)
        before = poses
    grown = resident_memory() - settled
    print(
        f"{len(room.whole.faces)} triangles, {speed} m/s: median {1e3 * np.median(took):.1f} ms a frame, 99 % below "
        f"{1e3 * np.quantile(took, 0.99):.1f} ms, least gap {1e3 * least:.2f} mm, still {longest:.2f} s, "
        f"{grown:+.1f} MB in the second half"
    )
    assert longest < 2.0
    assert grown < 30.0
    assert len(room.simulation._checkpoints) <= 1024

"""Twenty movers in a furnished room of half a million triangles, for long: nothing touches, leaves or gets stuck.

Embree, over the true triangles of both sides, says whether an edge of one goes through a face of the other.
"""

import time

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from dynamics import Body, Mover, SteppedSimulation, UniformMovementRandomBounce, cover
from dynamics.contact import TOUCH_COLUMNS, TOUCHES
from dynamics.obstacles import placed
from dynamics.rotation import matrix_from_quaternion
from dynamics.sweep import distances
from tests.benchmarks.room import DEPTH, HEIGHT, WIDTH, room
from tests.dynamics.solids import spheres_at
from tiscene.scene.obstacles import MeshTrees, ObstacleTree

FPS = 25


def chair() -> trimesh.Trimesh:
    parts = [((0.4, 0.04, 0.4), (0, 0, 0)), ((0.4, 0.45, 0.03), (0, 0.22, -0.185))]
    parts += [((0.04, 0.4, 0.04), (x, -0.2, z)) for x in (-0.17, 0.17) for z in (-0.17, 0.17)]
    made = [trimesh.creation.box(size) for size, _ in parts]
    return trimesh.util.concatenate([each.apply_translation(at) for each, (_, at) in zip(made, parts, strict=True)])


def solids() -> list[trimesh.Trimesh]:
    bowl = np.array([[0, 0], [0.1, 0.01], [0.14, 0.07], [0.13, 0.07], [0.09, 0.025], [0, 0.012]])
    return [
        chair(),
        trimesh.creation.torus(0.15, 0.04, major_sections=48, minor_sections=24),
        trimesh.creation.revolve(bowl, sections=48),
        trimesh.creation.icosphere(subdivisions=3, radius=0.12),
    ]


class Arena:
    def __init__(self, speed: float) -> None:
        self.stage = room()
        self.meshes = solids()
        shapes = [cover(mesh.triangles) for mesh in self.meshes]
        random = np.random.default_rng(1)
        starts: list[np.ndarray] = []
        while len(starts) < 20:
            start = random.uniform((0.7, 1.5, 0.7), (4.9, 2.5, 4.0))
            mine = shapes[len(starts) % 4].reach
            if all(np.linalg.norm(start - other) > mine + shapes[row % 4].reach for row, other in enumerate(starts)):
                starts.append(start)
        movers = []
        for row, start in enumerate(starts):
            dynamic = UniformMovementRandomBounce(speed, 2.0, tuple(random.normal(size=3)), seed=32)
            movers.append(Mover(Body(dynamic, tuple(start.tolist()), name=f"m{row}"), shapes[row % 4]))
        trees = MeshTrees.built(self.stage.meshes)
        tree = ObstacleTree(trees, self.stage.instances)
        self.tree = placed(trees.bvh, trees.wide, tree.roots, tree.matrices, tree.root)
        self.simulation = SteppedSimulation(movers, fps=FPS, obstacles=lambda _frame: self.tree)

    def gap(self, poses: np.ndarray) -> float:
        """Between all proxy spheres and the room, as far as 0.1 m."""
        spheres = [spheres_at(mover.shape, pose) for mover, pose in zip(self.simulation.movers, poses, strict=True)]
        points = np.zeros((sum(len(radii) for _, radii in spheres), 4), np.float32)
        points[:, :3] = np.concatenate([centres for centres, _ in spheres])
        touches = np.zeros((TOUCHES, TOUCH_COLUMNS), np.float32)
        distances(points, 0.2, touches, *self.tree.arguments())
        return float((points[:, 3] - np.concatenate([radii for _, radii in spheres])).min())

    def between(self, poses: np.ndarray) -> float:
        """Between the proxy spheres of different movers."""
        spheres = [spheres_at(mover.shape, pose) for mover, pose in zip(self.simulation.movers, poses, strict=True)]
        nearest = np.inf
        for row, (a, r) in enumerate(spheres):
            for other, (b, s) in enumerate(spheres[:row]):
                reach = sum(self.simulation.movers[each].shape.reach for each in (row, other))
                if np.linalg.norm(poses[row, :3] - poses[other, :3]) < reach:
                    gaps = np.linalg.norm(a[:, None] - b, axis=2) - r[:, None] - s
                    nearest = min(nearest, float(gaps.min()))
        return nearest

    def crossings(self, poses: np.ndarray) -> int:
        """Edges of the room that go through a mover's faces, and the other way round."""
        if not hasattr(self, "_rays"):
            parts = [
                trimesh.Trimesh(self.stage.meshes[i.mesh].positions, self.stage.meshes[i.mesh].triangles, process=False)
                .apply_transform(i.world_from_object) for i in self.stage.instances
            ]  # fmt: skip
            whole = trimesh.util.concatenate(parts)
            self._rays = RayMeshIntersector(whole, scale_to_box=False)
            self._ends = [whole.vertices[whole.edges_unique[:, side]] for side in (0, 1)]
            self._movers = [RayMeshIntersector(mesh, scale_to_box=False) for mesh in self.meshes]
        count = 0
        start, end = self._ends
        for row, pose in enumerate(poses):
            mesh, turn = self.meshes[row % 4], matrix_from_quaternion(pose[3:])
            corners = mesh.vertices @ turn.T + pose[:3]
            count += crossed(self._rays, corners[mesh.edges_unique[:, 0]], corners[mesh.edges_unique[:, 1]])
            reach = np.linalg.norm(mesh.vertices, axis=1).max() + 0.5 * np.linalg.norm(end - start, axis=1)
            near = np.linalg.norm(0.5 * (start + end) - pose[:3], axis=1) < reach
            if near.any():
                own = [(side[near] - pose[:3]) @ turn for side in (start, end)]
                count += crossed(self._movers[row % 4], *own)
        return count


def crossed(rays: RayMeshIntersector, start: np.ndarray, end: np.ndarray) -> int:
    """How many of the segments hit the mesh."""
    length = np.linalg.norm(end - start, axis=1)
    start, end, length = start[length > 1e-9], end[length > 1e-9], length[length > 1e-9]
    where, which, _ = rays.intersects_location(start, (end - start) / length[:, None], multiple_hits=False)
    return int((np.linalg.norm(where - start[which], axis=1) < length[which]).sum()) if len(which) else 0


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "frames"), [(1.5, 10_000), (20.0, 200)])
def test_twenty_movers_in_a_room(speed, frames):
    arena = Arena(speed)
    still = np.zeros(20)
    longest, took, before = 0.0, [], None
    least = np.inf
    for frame in range(frames):
        begun = time.perf_counter()
        moment = arena.simulation.frame(frame)
        took.append(time.perf_counter() - begun)
        poses = moment.poses
        assert (poses[:, :3] > 0.0).all()
        assert (poses[:, :3] < (WIDTH, HEIGHT, DEPTH)).all()
        if frame % 10 == 0:
            least = min(least, arena.gap(poses), arena.between(poses))
            assert least > 0.0, f"frame {frame}"
        if frame % (frames // 40) == 0:
            assert arena.crossings(poses) == 0, f"frame {frame}"
        if before is not None:
            slow = np.linalg.norm(poses[:, :3] - before[:, :3], axis=1) < 0.1 * speed / FPS
            still = np.where(slow, still + 1, 0)
            longest = max(longest, still.max() / FPS)
        before = poses
    print(f"{speed} m/s: {1e3 * np.median(took):.1f} ms a frame, least gap {1e3 * least:.2f} mm, still {longest:.2f} s")
    assert longest < 2.0
    assert len(arena.simulation._checkpoints) <= 1024

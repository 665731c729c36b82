# SPDX-License-Identifier: Apache-2.0
"""The label pass against Embree, on the same triangles as one mesh in world space."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from tests.render.label_scenes import Stage, crowd, static_view
from tiscene.scene.camera import Camera
from tiscene.scene.placement import CURRENT

WIDTH, HEIGHT = 256, 192
CAMERA = Camera.look_at((1.0, 0.8, 7.5), (0.1, 0.0, -1.0))


def flattened(stage: Stage) -> tuple[trimesh.Trimesh, NDArray[np.int32]]:
    """Return all triangles in world space, and the instance id of each."""
    vertices, faces, ids, count = [], [], [], 0
    for row, instance in enumerate(stage.instances):
        mesh = stage.meshes[instance.mesh]
        matrix = stage.placement.world_from_object[CURRENT, row]
        vertices.append(mesh.positions @ matrix[:, :3].T + matrix[:, 3])
        faces.append(mesh.triangles + count)
        ids.append(np.full(len(mesh.triangles), stage.placement.instance_id[row]))
        count += len(mesh.positions)
    whole = trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)
    return whole, np.concatenate(ids)


@pytest.fixture(scope="module")
def compared() -> dict[str, NDArray]:
    """Labels, and Embree's instance, depth, distance, position and normal at each pixel."""
    stage = crowd()
    assert len(stage.instances) >= 200
    whole, ids = flattened(stage)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    pose = CAMERA.world_from_camera()
    directions = pixels @ np.linalg.inv(CAMERA.intrinsics(WIDTH, HEIGHT)).T @ pose[:3, :3].T
    origins = np.broadcast_to(pose[:3, 3], directions.shape)
    triangle = RayMeshIntersector(whole, scale_to_box=False).intersects_first(origins, directions)
    hit = triangle >= 0
    # directions have z = 1 in the camera, so the ray parameter of the triangle's plane is the depth.
    normals, corners = whole.face_normals[triangle], whole.triangles[triangle, 0]
    depth = np.sum((corners - origins) * normals, axis=1) / np.sum(directions * normals, axis=1)
    facing = np.where(np.sum(directions * normals, axis=1)[:, None] > 0.0, -normals, normals)
    labels = stage.render(
        static_view(CAMERA, WIDTH, HEIGHT), "instance", "depth", "distance", "position", "geometric_normal"
    )
    return labels | {
        "embree_instance": np.where(hit, ids[triangle], 0).reshape(HEIGHT, WIDTH),
        "embree_depth": np.where(hit, depth, np.inf).reshape(HEIGHT, WIDTH),
        "embree_distance": np.where(hit, depth * np.linalg.norm(directions, axis=1), np.inf).reshape(HEIGHT, WIDTH),
        "embree_position": (origins + depth[:, None] * directions).reshape(HEIGHT, WIDTH, 3),
        "embree_normal": facing.reshape(HEIGHT, WIDTH, 3),
    }


def test_scene_shows_many_instances_and_background(compared: dict[str, NDArray]) -> None:
    assert len(np.unique(compared["instance"])) > 150
    assert 0.01 < np.mean(compared["instance"] == 0) < 0.5


def test_instances_match_embree(compared: dict[str, NDArray]) -> None:
    assert np.mean(compared["instance"] == compared["embree_instance"]) >= 0.999


@pytest.mark.parametrize("name", ["depth", "distance"])
def test_distances_match_embree(compared: dict[str, NDArray], name: str) -> None:
    ours, theirs = compared[name], compared[f"embree_{name}"]
    assert np.mean(np.isclose(ours, theirs, rtol=1e-4, atol=0.0)) >= 0.999


def test_positions_and_normals_match_embree(compared: dict[str, NDArray]) -> None:
    same = (compared["instance"] == compared["embree_instance"]) & (compared["instance"] > 0)
    apart = np.linalg.norm(compared["position"] - compared["embree_position"], axis=-1)[same]
    assert np.mean(apart < 1e-4) >= 0.999
    cosine = np.sum(compared["geometric_normal"] * compared["embree_normal"], axis=-1)[same]
    assert np.mean(cosine > 0.9999) >= 0.998  # on a shared edge either triangle may be hit

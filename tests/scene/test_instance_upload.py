# SPDX-License-Identifier: Apache-2.0
"""The layout of GPUs places the instances of a frame with one upload, and several frames at once."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.render.tracing import placed, random_matrices, scene_of, shape
from tiscene.errors import ArgumentError
from tiscene.scene import device_scene
from tiscene.scene.bvh import layout_kernels
from tiscene.scene.instance_upload import INFO_COLOR, INFO_FLAGS, OWN_COLOR, OWN_OPACITY
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

ARRAYS = ("instance_info", "world_from_instance", "instance_from_world", "box_from_instance")
MESHES = (shape(trimesh.creation.box()), shape(trimesh.creation.icosphere(subdivisions=1)))


def placement(seed: int, count: int = 20) -> Placement:
    random = np.random.default_rng(seed)
    made = placed(np.arange(count) % 2, random_matrices(random, 3 * count, 3.0).reshape(3, count, 3, 4))
    columns = {"category_id": random.integers(0, 9, count).astype(np.int32), "part": np.arange(count, dtype=np.int32)}
    color = None if seed == 5 else random.random((3, count, 4), np.float32)
    if color is not None:
        color[:, ::3, :3], color[:, 1::4, 3] = np.nan, np.nan
    return replace(made, **columns, color=color)


def test_arrays_equal_those_that_are_uploaded_one_by_one() -> None:
    first = scene_of(MESHES, placement(1), "bvh8")
    packed = scene_of(MESHES, placement(1), "bvh2")
    for seed, count in ((2, 20), (3, 7), (4, 70)):
        for scene in (first, packed):
            scene.place(placement(seed, count), (PREVIOUS, CURRENT, NEXT))
        for name in ARRAYS:
            one, other = (getattr(scene, name).to_numpy().copy() for scene in (first, packed))
            if name == "instance_info":  # references of trees differ between the layouts
                one, other = (np.delete(each, [0, *range(9, 17)], axis=1) for each in (one, other))
            np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.parametrize("traversal", ["bvh8", "bvh2"])
def test_colors_of_instances_are_uploaded_when_nothing_else_changes(traversal: str) -> None:
    first = placed(np.arange(20) % 2, np.tile(np.eye(4)[:3], (3, 20, 1, 1)))
    scene = scene_of(MESHES, first, traversal)
    color = np.full((3, 20, 4), 0.25, np.float32)
    color[CURRENT, :10, :3], color[CURRENT, 10:, 3], color[NEXT] = np.nan, np.nan, 0.75
    scene.place(replace(first, color=color), (CURRENT, NEXT))
    info, then = scene.instance_info.to_numpy(), scene.instances_at(NEXT).to_numpy()
    own = info[:, INFO_FLAGS] & (OWN_COLOR | OWN_OPACITY)
    assert own.tolist() == [OWN_OPACITY] * 10 + [OWN_COLOR] * 10
    np.testing.assert_array_equal(info[:, INFO_COLOR:].view(np.float32), color[CURRENT])
    np.testing.assert_array_equal(then[:, INFO_COLOR:].view(np.float32), color[NEXT])


def test_frame_takes_one_upload(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(MESHES, placement(1), "bvh2")
    uploads = []
    upload = device_scene.upload_packed
    monkeypatch.setattr(device_scene, "upload_packed", lambda *args: uploads.append(1) or upload(*args))
    monkeypatch.setattr(layout_kernels, "write_rows", lambda *args: uploads.append(1))
    for name in ARRAYS:
        monkeypatch.setattr(getattr(scene, name), "from_numpy", lambda _values: uploads.append(1), raising=False)
    scene.place(placement(2), (PREVIOUS, CURRENT, NEXT))
    assert scene.nodes is scene.nodes
    assert uploads == [1]


@pytest.mark.parametrize("traversal", ["bvh8", "bvh2"])
def test_frames_follow_each_other(traversal: str) -> None:
    placements = [placement(seed, count) for seed, count in ((5, 9), (6, 0), (7, 12))]
    scene = scene_of(MESHES, placements[0], traversal)
    scene.place_frames(placements, (CURRENT, NEXT))
    first = 0
    for each in placements:
        end = first + len(each.mesh)
        single = scene_of(MESHES, each, traversal)
        for name in ARRAYS if len(each.mesh) else ():
            found, expected = getattr(scene, name).to_numpy(), getattr(single, name).to_numpy()
            part = found[:, first:end] if found.ndim == 3 else found[first:end]
            if name == "instance_info" and each.color is None:  # colors of instances without any are not read
                part, expected = part[:, :INFO_COLOR], expected[:, :INFO_COLOR]
            np.testing.assert_array_equal(part, expected, err_msg=name)
        first = end
    roots = scene.frame_roots(CURRENT).to_numpy(), scene.frame_roots(NEXT).to_numpy()
    assert roots[0][1] == roots[1][1] == 0  # the empty node
    assert len({*roots[0].tolist(), *roots[1].tolist()}) == 5
    with pytest.raises(ArgumentError, match="no frames are placed"):
        scene.frame_roots(PREVIOUS)
    scene.place(placements[0])
    with pytest.raises(ArgumentError, match="no frames are placed"):
        scene.frame_roots(CURRENT)

# SPDX-License-Identifier: Apache-2.0
"""Budgets of the rooms: triangles, reading time, device memory; and labels of all their objects."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import trimesh
from PIL import Image
from pxr import Sdf, Usd

from docs.tools.gallery import PACKAGE, PLACES
from tests.device.programs import run_python
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage

ROOMS = tuple(PLACES)
HOME = 2.5  # a home of five rooms may be this many times as large as a room
# Prints the bytes of all Taichi arrays once a scene has been rendered.
ARRAYS = """
import gc, sys
import numpy as np
from taichi.lang._ndarray import Ndarray
import tiscene as ts
stream = ts.Stream(sys.argv[1], width=256, height=192, spp=1, buffers=("rgb",))
assert np.ptp(stream[0].rgb) > 0
gc.collect()
arrays = [each for each in gc.get_objects() if isinstance(each, Ndarray)]
print(sum(each._get_nelement() * each._get_element_size() for each in arrays))
"""
RATIO = 6.0  # reading a room may take this many times the seconds of libraries; 1.7 to 3.4 measured


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.slow) if name == "home_01" else name for name in ROOMS],
)
def room(request: pytest.FixtureRequest) -> tuple[SceneDescription, float]:
    """Return a room and the processor time of reading it, s."""
    start = time.process_time()
    description = read_stage(PACKAGE / request.param / "scene.usda")
    return description, time.process_time() - start


def seconds_of_libraries(path: Path, description: SceneDescription) -> float:
    """Return the processor time, s, that libraries take for the values, pictures and meshes of a stage.

    OpenUSD hands out the values of all attributes, Pillow decodes the pictures that they name, and trimesh merges
    the vertices of the meshes. Nothing is bound, triangulated or labeled.
    """
    start = time.process_time()
    stage = Usd.Stage.Open(str(path))
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    values = [attribute.Get() for prim in prims for attribute in prim.GetAttributes()]
    pictures = {value.resolvedPath for value in values if isinstance(value, Sdf.AssetPath)}
    for name in pictures:
        if name.endswith((".png", ".jpg")):
            with Image.open(name) as picture:
                picture.load()
    for mesh in description.meshes:
        trimesh.Trimesh(mesh.positions, mesh.triangles)
    return time.process_time() - start


@pytest.mark.slow
def test_room_is_read_in_a_few_times_the_seconds_of_libraries(room: tuple[SceneDescription, float]) -> None:
    description, seconds = room
    assert seconds < RATIO * seconds_of_libraries(PACKAGE / description.name / "scene.usda", description)


def test_room_has_less_than_800_000_unique_triangles(room: tuple[SceneDescription, float]) -> None:
    scale = HOME if room[0].name == "home_01" else 1.0
    assert 100_000 < sum(len(mesh.triangles) for mesh in room[0].meshes) / scale < 800_000


def test_every_static_object_has_a_label_and_its_own_instances(room: tuple[SceneDescription, float]) -> None:
    description, _ = room
    paths = [record.prim_path for record in description.objects]
    assert len(set(paths)) == len(paths)
    assert all(record.category for record in description.objects)
    assert len({record.category for record in description.objects}) >= 12
    assert {instance.object for instance in description.instances} == set(range(len(paths)))


@pytest.mark.slow
@pytest.mark.parametrize("scene", ROOMS)
def test_room_takes_less_than_400_megabytes_on_device(scene: str) -> None:
    size = float(run_python(ARRAYS, scene))  # in a process of its own: other tests leave arrays behind
    assert 20e6 < size / (HOME if scene == "home_01" else 1.0) < 400e6

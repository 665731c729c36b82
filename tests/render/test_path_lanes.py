"""`shade_plain`: the same bytes as `shade`, in scenes where it can take all, some or hardly any of the paths."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.render.path_scenes import (
    BOX_CAMERA,
    CORNELL,
    WHITE,
    ball,
    box,
    described,
    device_scene,
    matte,
    quad,
    towards,
)
from tiscene.render.integrators import path
from tiscene.render.integrators.path import PathImage, PathPass
from tiscene.render.integrators.path_state import SHADED
from tiscene.render.view import View
from tiscene.scene.description import (
    DiskLight,
    Light,
    Material,
    Mesh,
    RectLight,
    SceneDescription,
    Shaping,
    Texture,
    TextureLookup,
)
from tiscene.scene.material_table import PLAIN

SIZE = (21, 19)
COUNT = 2 * 21 * 19  # paths, at two a pixel
VIEW = View(BOX_CAMERA, BOX_CAMERA, BOX_CAMERA, *SIZE)
BELOW_THE_CEILING = towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0))
LAMP = RectLight("lamp", "/lamp", BELOW_THE_CEILING, (18.0, 15.0, 8.0), 0.6, 0.5)
SMALL = replace(LAMP, width=0.01, height=0.01, radiance=(3e4, 3e4, 2e4))
NEAR = replace(
    LAMP, world_from_light=towards((-0.9, 0.4, 0.2), (1.0, 0.1, 0.0)), diffuse=0.5, specular=2.0, indirect=0.3
)
CHEQUERS = Texture("t", (np.indices((8, 8, 4)).sum(0) % 2 * 200 + 50).astype(np.uint8))
THINGS = [
    matte("painted", TextureLookup(0)),
    Material("glossy", diffuse_color=(0.4, 0.5, 0.6), roughness=0.3),
    Material("glass", opacity=0.1, ior=1.5, roughness=0.0),
    matte("net", (0.7, 0.7, 0.2), opacity=0.5),
    matte("orange", (0.9, 0.5, 0.1)),
]


def plain_room(*lights: Light, more: tuple[Mesh, ...] = (), materials: tuple[Material, ...] = ()) -> SceneDescription:
    meshes, walls = box(CORNELL)
    return described([*meshes, *more], [*walls, *materials], list(lights), [CHEQUERS])


def full_room(light: Light) -> SceneDescription:
    """A ball of each of THINGS and a leaning board whose two sides are seen, all of them stretched and mirrored."""
    balls = [ball((-0.75 + 0.3 * k, -0.8 + 0.15 * k, 0.5), 0.14, material=3 + k) for k in range(len(THINGS))]
    board = quad((-0.9, -1.0, -0.8), (0.0, -1.0, -0.9), (0.3, 0.6, -0.6), (-0.8, 0.5, 0.0), material=2 + len(THINGS))
    description = plain_room(light, more=(*balls, board), materials=tuple(THINGS))
    stretched = trimesh.transformations.euler_matrix(0.1, 0.2, 0.3) @ np.diag([0.9, 1.1, -0.8, 1.0])
    things = len(THINGS) + 1
    instances = [replace(each, world_from_object=stretched) for each in description.instances[-things:]]
    return replace(description, instances=(*description.instances[:-things], *instances))


def pictures(description: SceneDescription, *, spp: int, max_depth: int, mis: bool = True) -> list[PathImage]:
    """With `shade_plain` and without."""
    paths = PathPass(device_scene(description), *SIZE)
    scene = paths.scene_arrays()
    assert scene.plainly_lit
    scenes = scene, replace(scene, plainly_lit=False)
    return [
        paths.render(VIEW, frame_index=0, seed=3, spp=spp, max_depth=max_depth, mis=mis, scene=each) for each in scenes
    ]


@pytest.mark.parametrize(
    ("make", "light", "numbers"),
    [
        (plain_room, LAMP, {"spp": 5, "max_depth": 7}),
        (plain_room, SMALL, {"spp": 2, "max_depth": 3}),
        (full_room, LAMP, {"spp": 7, "max_depth": 9}),
        (full_room, NEAR, {"spp": 4, "max_depth": 4}),
        (full_room, NEAR, {"spp": 1, "max_depth": 2}),
        (full_room, LAMP, {"spp": 3, "max_depth": 5, "mis": False}),
    ],
)
def test_same_bytes(make: Callable[[Light], SceneDescription], light: Light, numbers: dict[str, int]) -> None:
    in_lanes, one_by_one = pictures(make(light), **numbers)
    assert one_by_one.hdr.mean() > 0.01
    for name in ("hdr", "albedo", "normal"):
        assert np.array_equal(getattr(in_lanes, name), getattr(one_by_one, name)), name


def test_it_takes_what_is_plain_and_leaves_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    taken, met = [], []

    def noted(*arguments: object) -> None:
        taken.append((paths._state.status.to_numpy()[:COUNT] & SHADED) != 0)
        met.append(paths._state.hit_ids.to_numpy()[:COUNT])
        shade(*arguments)

    shade = path.shade
    monkeypatch.setattr(path, "shade", noted)
    scene = device_scene(full_room(LAMP))
    paths = PathPass(scene, *SIZE)
    paths.render(VIEW, frame_index=0, seed=3, spp=2, max_depth=2)
    flags = np.array(scene.materials.flags)[scene.triangle_material.to_numpy()[met[0][:, 1]]]
    plain = (met[0][:, 0] >= 0) & (flags & PLAIN != 0)
    assert np.count_nonzero(plain & ~taken[0]) < 0.02 * COUNT  # before those is the lamp
    assert 0.5 < taken[0].mean() < 0.95
    assert not taken[0][~plain].any()
    assert not (paths._state.status.to_numpy()[:COUNT] & SHADED).any()


@pytest.mark.parametrize(
    "lights",
    [
        [],
        [LAMP, LAMP],
        [DiskLight("lamp", "/lamp", BELOW_THE_CEILING, WHITE, 0.3)],
        [replace(LAMP, texture=0)],
        [replace(LAMP, shaping=Shaping(cone_angle=0.5))],
        [replace(LAMP, casts_shadows=False)],
    ],
)
def test_other_lights_are_not_for_it(lights: list[Light]) -> None:
    assert not PathPass(device_scene(plain_room(*lights)), 4, 4).scene_arrays().plainly_lit


def test_nor_are_scenes_without_plain_surfaces_or_with_the_other_tree() -> None:
    painted = described([ball((0.0, 0.0, 0.0), 0.5)], [THINGS[0]], [LAMP], [CHEQUERS])
    assert not PathPass(device_scene(painted), 4, 4).scene_arrays().plainly_lit
    assert not PathPass(device_scene(plain_room(LAMP), "binary"), 4, 4).scene_arrays().plainly_lit

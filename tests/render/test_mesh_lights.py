"""Meshes that give light: sampled without bias, with little noise, wherever they are; and which of their triangles."""

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.room import still
from tests.render.path_scenes import BOX_CAMERA, CORNELL, ball, box, described, device_scene, matte, quad, render
from tiscene.scene.description import Instance, Material, Mesh, SceneDescription, Texture, TextureLookup
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.light_nodes import BACK, ROUND, STRENGTH, members, places
from tiscene.scene.mesh_lights import glow_of, mesh_light

GLOW = (12.0, 9.0, 6.0)


def room(*lamps: Mesh, material: Material | None = None, textures: tuple[Texture, ...] = ()) -> SceneDescription:
    """A dark room with things that glow."""
    meshes, materials = box(CORNELL)
    glow = material or matte("glow", (0.1, 0.1, 0.1), emissive_color=GLOW)
    return described([*meshes, *lamps], [*materials, glow], [], list(textures))


def screen() -> tuple[Mesh, Material, Texture]:
    """A picture with one bright corner, on a panel that hangs in the room and emits on both sides."""
    pixels = np.full((8, 8, 4), 0.05, np.float32)
    pixels[:3, :3, :3] = 8.0
    panel = quad((-0.4, 0.1, 0.3), (0.3, 0.1, 0.5), (0.3, 0.6, 0.4), (-0.4, 0.6, 0.2), material=3)
    emission = TextureLookup(0, scale=(2.0, 1.5, 1.0, 1.0))
    material = Material("screen", diffuse_color=(0.0, 0.0, 0.0), ior=1.0, emissive_color=emission)
    return panel, material, Texture("picture", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")


def bulb() -> SceneDescription:
    return room(ball((0.2, 0.4, 0.3), 0.08, 3, 2))


def squashed() -> SceneDescription:
    """Mirrored, and stretched by different factors."""
    scene = room(ball((0.0, 0.0, 0.0), 0.1, 3, 2))
    matrix = np.diag([-0.4, 1.0, 2.5, 1.0])
    matrix[:3, 3] = (0.2, 0.4, 0.3)
    *others, lamp = scene.instances
    return replace(scene, instances=(*others, replace(lamp, world_from_object=matrix)))


def lit_screen() -> SceneDescription:
    panel, material, texture = screen()
    return room(panel, material=material, textures=(texture,))


def lace() -> SceneDescription:
    """Only a third of it is there."""
    material = matte("lace", (0.1, 0.1, 0.1), emissive_color=GLOW, opacity=0.3, opacity_mode="presence")
    return room(ball((0.2, 0.4, 0.3), 0.15, 3, 2), material=material)


def globe() -> SceneDescription:
    """A large one just above the floor, which is lit from as near as rays start off a surface."""
    return room(ball((0.0, -0.55, 0.6), 0.44, 3, 3))


SCENES = {"bulb": bulb, "globe": globe, "squashed": squashed, "screen": lit_screen, "lace": lace}


def unsampled(scene: DeviceScene) -> DeviceScene:
    """The same, but that only paths that run into what glows see it."""
    scene.lights.place_meshes([], np.zeros((0, 3, 4)))
    return scene


@pytest.mark.parametrize("name", SCENES)
def test_sampling_changes_the_noise_and_not_the_picture(name: str) -> None:
    description = SCENES[name]()
    scenes = {"sampled": (device_scene(description), True), "lights alone": (device_scene(description), False)}
    scenes["unsampled"] = unsampled(device_scene(description)), True
    runs = {}
    for kind, (scene, mis) in scenes.items():
        spp = 256 if kind == "unsampled" else 64
        images = [render(scene, BOX_CAMERA, spp=spp, max_depth=3, seed=seed, mis=mis).hdr for seed in range(8)]
        runs[kind] = np.array(images, np.float64)
    means = {kind: images.mean(axis=(1, 2, 3)) for kind, images in runs.items()}
    for kind in ("sampled", "lights alone"):
        error = np.hypot(means[kind].std(ddof=1), means["unsampled"].std(ddof=1)) / np.sqrt(8)
        assert error < 0.02 * means["unsampled"].mean()
        assert abs(means[kind].mean() - means["unsampled"].mean()) < 4.0 * error, kind
    # Where the lamp is not seen itself. The unsampled had four times as many paths.
    noise = {kind: np.median(images.var(axis=0)) for kind, images in runs.items()}
    assert noise["sampled"] < (0.6 if name == "globe" else 0.25) * noise["unsampled"]


def test_a_lamp_that_moves_is_sampled_where_it_is() -> None:
    description = bulb()
    placement = still(description)
    scene = device_scene(description)
    before = render(scene, BOX_CAMERA, spp=4).hdr
    moved = placement.world_from_object.copy()
    moved[:, -1, :, 3] += (-0.5, -0.3, 0.1)
    scene.place(replace(placement, world_from_object=moved))
    *others, lamp = description.instances
    elsewhere = Instance(lamp.mesh, lamp.object, np.vstack([moved[1, -1], (0.0, 0.0, 0.0, 1.0)]))
    there = render(scene, BOX_CAMERA, spp=4).hdr
    assert not np.array_equal(there, before)
    np.testing.assert_array_equal(
        there, render(replace(description, instances=(*others, elsewhere)), BOX_CAMERA, spp=4).hdr
    )
    scene.place(placement)
    np.testing.assert_array_equal(render(scene, BOX_CAMERA, spp=4).hdr, before)
    absent = placement.present.copy()
    absent[:, -1] = False
    scene.place(replace(placement, present=absent))
    assert not render(scene, BOX_CAMERA, spp=4).hdr.any()


def test_the_tree_of_a_mesh_has_every_triangle_that_glows() -> None:
    mesh = ball((0.0, 0.0, 0.0), 0.5, subdivisions=2)
    glow = np.where(np.arange(len(mesh.triangles)) % 3 == 0, 2.0, 0.0)
    light = mesh_light(mesh, glow)
    assert light is not None
    rows, _ = places(light.nodes)
    assert sorted(rows) == list(np.flatnonzero(glow))
    assert members(light.nodes[0])[:, STRENGTH].sum() == pytest.approx(light.whole[STRENGTH], rel=1e-5)
    assert light.whole[ROUND] > 0.9
    assert light.whole[BACK] < 0.1  # it is closed: its inside is not seen
    panel = mesh_light(quad((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), np.ones(2))
    assert panel is not None
    assert (members(panel.nodes[0])[:, BACK] == 1.0).all()
    assert panel.whole[STRENGTH] == pytest.approx(1.0)
    assert mesh_light(mesh, np.zeros(len(mesh.triangles))) is None


def test_a_picture_glows_by_its_mean() -> None:
    _, material, texture = screen()
    mean = texture.pixels[..., :3].mean()
    assert glow_of(material, (texture,)) == pytest.approx(mean * (2.0 * 0.2126 + 1.5 * 0.7152 + 0.0722), rel=1e-5)
    assert glow_of(matte("grey", (0.5, 0.5, 0.5)), ()) == 0.0

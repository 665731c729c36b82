# SPDX-License-Identifier: Apache-2.0
"""Emissive meshes: unbiased light sampling with low noise, under transforms; densities of their triangles."""

from dataclasses import replace

import numpy as np
import pytest
import taichi as ti

from tests.benchmarks.room import static_placement
from tests.reference.chi_square import MIN_P_VALUE, chi_square
from tests.reference.ray_casting import cast
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
    render,
)
from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1
from tiscene.render.bsdfs.material_inputs import Materials
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.intersect.surface_interaction import Geometry
from tiscene.render.lights import emissive_mesh
from tiscene.render.lights.importance import EntryWeights, weigh_entries
from tiscene.render.lights.light_sample import lights_of
from tiscene.render.lights.light_sampler import choose_light
from tiscene.render.texture_lookup import Textures
from tiscene.scene.bvh.obstacle_tree import ObstacleTree
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, Material, Mesh, SceneDescription, Texture, TextureLookup
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_tree import BACK, MAX_ENTRIES, ROUND, STRENGTH, child_rows, light_slots
from tiscene.scene.lights.mesh_lights import build_mesh_light, mean_emission

EMISSION = (12.0, 9.0, 6.0)


def room(*lamps: Mesh, material: Material | None = None, textures: tuple[Texture, ...] = ()) -> SceneDescription:
    """Return a dark room with emissive meshes."""
    meshes, materials = box(CORNELL)
    emission = material or matte("emission", (0.1, 0.1, 0.1), emissive_color=EMISSION)
    return described([*meshes, *lamps], [*materials, emission], [], list(textures))


def screen() -> tuple[Mesh, Material, Texture]:
    """Return a panel that emits on both sides, with a texture with one bright corner."""
    pixels = np.full((8, 8, 4), 0.05, np.float32)
    pixels[:3, :3, :3] = 8.0
    panel = quad((-0.4, 0.1, 0.3), (0.3, 0.1, 0.5), (0.3, 0.6, 0.4), (-0.4, 0.6, 0.2), material=3)
    emission = TextureLookup(0, scale=(2.0, 1.5, 1.0, 1.0))
    material = Material("screen", diffuse_color=(0.0, 0.0, 0.0), ior=1.0, emissive_color=emission)
    return panel, material, Texture("screen", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")


def bulb() -> SceneDescription:
    return room(ball((0.2, 0.4, 0.3), 0.08, 3, 2))


def squashed() -> SceneDescription:
    """Return a room with a mirrored, non-uniformly scaled lamp."""
    scene = room(ball((0.0, 0.0, 0.0), 0.1, 3, 2))
    matrix = np.diag([-0.4, 1.0, 2.5, 1.0])
    matrix[:3, 3] = (0.2, 0.4, 0.3)
    *others, lamp = scene.instances
    return replace(scene, instances=(*others, replace(lamp, world_from_object=matrix)))


def lit_screen() -> SceneDescription:
    panel, material, texture = screen()
    return room(panel, material=material, textures=(texture,))


def lace() -> SceneDescription:
    """Return a room with a lamp of presence 0.3."""
    material = matte("lace", (0.1, 0.1, 0.1), emissive_color=EMISSION, opacity=0.3, opacity_mode="presence")
    return room(ball((0.2, 0.4, 0.3), 0.15, 3, 2), material=material)


def globe() -> SceneDescription:
    """Return a room with a large lamp so close to the floor that ray offsets matter."""
    return room(ball((0.0, -0.55, 0.6), 0.44, 3, 3))


SCENES = {"bulb": bulb, "globe": globe, "squashed": squashed, "screen": lit_screen, "lace": lace}


def unsampled(scene: DeviceScene) -> DeviceScene:
    """Remove emissive meshes from the light table, so that only BSDF sampling finds them."""
    scene.lights.place_meshes([], np.zeros((0, 3, 4)))
    return scene


@pytest.mark.parametrize(
    "name", ["bulb", "screen", "lace", *(pytest.param(each, marks=pytest.mark.slow) for each in ("globe", "squashed"))]
)
def test_light_sampling_reduces_noise_without_bias(name: str) -> None:
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
    # The median excludes pixels that show the lamp. "unsampled" has four times the samples.
    noise = {kind: np.median(images.var(axis=0)) for kind, images in runs.items()}
    assert noise["sampled"] < (0.6 if name == "globe" else 0.25) * noise["unsampled"]


@pytest.mark.parametrize(("radius", "height", "x"), [(0.001, 4.0, 0.0), (0.1, 0.5, 1e3)])
def test_small_or_distant_sphere_shades_only_its_far_side(radius: float, height: float, x: float) -> None:
    """A sphere of radiance 1 gives a white floor below it the radiance (radius / height)²."""
    floor = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))
    description = described(
        [floor, ball((0, 0, 0), radius, 1)], [matte("white", WHITE), matte("lamp", (0, 0, 0), emissive_color=WHITE)]
    )
    floor_to_world, lamp_to_world = np.eye(4), np.eye(4)
    floor_to_world[:3, 3], lamp_to_world[:3, 3] = (x, 0, 0), (x, height, 0)
    instances = Instance(0, 0, floor_to_world), Instance(1, 1, lamp_to_world)
    camera = Camera.look_at((x, 0.3 * height, 0.01), (x, 0.0, 0.0), vertical_fov=0.001)
    image = render(replace(description, instances=instances), camera, (8, 8), spp=64, max_depth=2)
    np.testing.assert_allclose(image.hdr.mean() / (radius / height) ** 2, 1.0, atol=0.01)


def test_moved_emissive_instance_is_sampled_at_its_new_pose() -> None:
    description = bulb()
    placement = static_placement(description)
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


def test_mesh_light_tree_contains_all_emissive_triangles() -> None:
    mesh = ball((0.0, 0.0, 0.0), 0.5, subdivisions=2)
    emission = np.where(np.arange(len(mesh.triangles)) % 3 == 0, 2.0, 0.0)
    light = build_mesh_light(mesh, emission)
    assert light is not None
    rows, _ = light_slots(light.nodes)
    assert sorted(rows) == list(np.flatnonzero(emission))
    assert child_rows(light.nodes[0])[:, STRENGTH].sum() == pytest.approx(light.whole[STRENGTH], rel=1e-5)
    assert light.whole[ROUND] > 0.9
    assert light.whole[BACK] < 0.1  # closed: back faces are invisible
    panel = build_mesh_light(quad((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), np.ones(2))
    assert panel is not None
    assert (child_rows(panel.nodes[0])[:, BACK] == 1.0).all()
    assert panel.whole[STRENGTH] == pytest.approx(1.0)
    assert build_mesh_light(mesh, np.zeros(len(mesh.triangles))) is None


def test_mean_emission_of_texture_is_its_mean_luminance() -> None:
    _, material, texture = screen()
    mean = texture.pixels[..., :3].mean()
    assert mean_emission(material, (texture,)) == pytest.approx(mean * (2.0 * 0.2126 + 1.5 * 0.7152 + 0.0722), rel=1e-5)
    assert mean_emission(matte("gray", (0.5, 0.5, 0.5)), ()) == 0.0


@ti.kernel
@bundled
def from_origin(
    geometry: Geometry,
    materials: Materials,
    textures: Textures,
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    energy: Floats1,
    numbers: Floats2,
    triangles: Ints1,
    rays: Floats2,
):
    """Sample a direction to the only light from each row of numbers; write direction, distance, density to rays [n, 5].

    Where `triangles` is not negative, write only the density of the given direction and distance for that triangle.
    """
    lights = ti.static(lights_of(light_values, light_nodes, light_distribution, geometry, materials, True))
    for i in range(rays.shape[0]):
        origin = ti.math.vec3(0.0)
        if triangles[i] >= 0:
            direction = ti.math.vec3(rays[i, 0], rays[i, 1], rays[i, 2])
            rays[i, 4] = emissive_mesh.pdf(lights, 0, triangles[i], origin, direction, rays[i, 3])
        else:
            weights = ti.Vector.zero(ti.f32, MAX_ENTRIES)
            count, scale, _ = weigh_entries(lights, origin, ti.math.vec3(0.0), weights, weights, False)
            entries = ti.static(EntryWeights(weights, weights, count, scale, scale))
            row, slot, chance, rest = choose_light(lights, entries, origin, ti.math.vec3(0.0), numbers[i, 0])
            found = emissive_mesh.sample(lights, textures, row, slot, origin, ti.math.vec2(rest, numbers[i, 1]))
            for c in ti.static(range(3)):
                rays[i, c] = found.direction[c]
            rays[i, 3], rays[i, 4] = found.distance, found.pdf * chance.x


@pytest.mark.parametrize("matrix", [np.eye(3), np.diag([-0.6, 1.0, 1.5])], ids=["round", "squashed"])
def test_directions_to_a_mesh_follow_density(matrix: np.ndarray) -> None:
    """On the half of a ball that faces the origin, so that each direction hits one triangle, bright or dark."""
    whole = ball((0.0, 0.0, 0.0), 0.5, subdivisions=1)
    place = np.column_stack([matrix, (0.2, 0.1, -1.2)])
    corners = (whole.positions @ matrix.T + place[:, 3])[whole.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * np.linalg.det(matrix)
    faces = whole.triangles[(normals * corners[:, 0]).sum(axis=1) < 0.0]
    half = replace(whole, triangles=faces, materials=(np.arange(len(faces)) % 2).astype(np.int32), normals=None)
    emission = [matte(str(k), (0.0, 0.0, 0.0), emissive_color=(k, k, k)) for k in (1.0, 4.0)]
    description = described([half], emission)
    description = replace(description, instances=(Instance(0, 0, np.vstack([place, (0.0, 0.0, 0.0, 1.0)])),))
    arrays = PathPass(device_scene(description), 8, 8).scene_arrays().arrays
    count = 30_000
    rays = np.zeros((count, 5), np.float32)
    numbers = np.random.default_rng(1).random((count, 2), np.float32)
    from_origin(*arrays, numbers, np.full(count, -1, np.int32), rays)
    assert (rays[:, 4] > 0.0).all()

    def density(directions: np.ndarray) -> np.ndarray:
        """Return densities of unit vectors."""
        rays_in = np.zeros((len(directions), 8), np.float32)
        rays_in[:, 4:7], rays_in[:, 7] = directions, np.inf
        hits = cast((half,), static_placement(description), rays_in)
        is_hit = hits.triangle >= 0
        result = np.zeros((int(is_hit.sum()), 5), np.float32)
        result[:, :3], result[:, 3] = directions[is_hit], hits.t[is_hit]
        from_origin(*arrays, result[:, :3].copy(), hits.triangle[is_hit].astype(np.int32), result)
        values = np.zeros(len(directions))
        values[is_hit] = result[:, 4]
        return values

    again = density(rays[:2000, :3].astype(np.float64))
    assert np.isclose(again, rays[:2000, 4], rtol=1e-3).mean() > 0.99  # except at edges
    assert rays[:, 4].max() > 3.0 * rays[:, 4].min()
    points = rays[:, :2].astype(np.float64) / -rays[:, 2:3]

    def projected(points: np.ndarray) -> np.ndarray:
        towards = np.concatenate([points, -np.ones((len(points), 1))], axis=1)
        length = np.linalg.norm(towards, axis=1)
        return density(towards / length[:, None]) / length**3

    low, high = points.min(axis=0) - 0.01, points.max(axis=0) + 0.01
    assert chi_square(points, projected, tuple(low), tuple(high), (8, 8), 48) > MIN_P_VALUE


def test_lamp_that_is_flat_but_for_rounding_errors_is_left_out() -> None:
    """The cofactors of its matrix give a determinant of 9e-16, and LAPACK finds the matrix singular."""
    flat = np.eye(4)
    flat[:2, :2] = (1.5, 4.35), (1.8, 5.22)
    floor, lamp = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)), ball((0.0, 0.0, 0.0), 0.1, 1, 2)
    materials = [matte("white", WHITE), matte("lamp", (0.0, 0.0, 0.0), emissive_color=EMISSION)]
    description = described([floor, lamp], materials)
    instances = description.instances[0], Instance(1, 1, flat)
    scene = device_scene(replace(description, instances=instances))
    assert scene.lights.arrays(scene.textures).values.shape[0] == 1, "no row is left, and arrays have at least one"
    assert ObstacleTree(scene.trees, instances).rows.tolist() == [0]


def test_light_table_does_not_depend_on_triangles_of_other_meshes() -> None:
    """Its numbers are float32, which cannot tell apart rows of more than 2^24 triangles."""
    before, lamp, after = ball((0.0, 0.0, 0.0), 0.5), ball((2.0, 0.0, 0.0), 0.1, 1, 2), ball((0.0, 2.0, 0.0), 0.5)
    materials = [matte("white", WHITE), matte("lamp", (0.0, 0.0, 0.0), emissive_color=EMISSION)]
    first, last = (device_scene(described(meshes, materials)) for meshes in ([lamp, after], [before, lamp]))
    moved, unmoved = (scene.lights.arrays(scene.textures) for scene in (last, first))
    np.testing.assert_array_equal(moved.nodes.to_numpy(), unmoved.nodes.to_numpy())
    np.testing.assert_array_equal(moved.distribution.to_numpy(), unmoved.distribution.to_numpy())

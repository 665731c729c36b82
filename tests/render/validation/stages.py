# SPDX-License-Identifier: Apache-2.0
"""Small scenes that both tiscene and Mitsuba can render, each for one kind of light, material or camera."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tests.render.path_scenes import WHITE, ball, box, described, matte, quad, towards
from tiscene.scene.camera import Camera
from tiscene.scene.description import (
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    ExtendedLobes,
    Instance,
    Light,
    Material,
    Mesh,
    RectLight,
    SceneDescription,
    SphereLight,
    Texture,
    TextureLookup,
)

CAMERA = Camera.look_at((0.0, 0.4, 3.6), (0.0, 0.0, 0.0), vertical_fov=np.radians(38.0))
DOWN = (0.0, -1.0, 0.0)
GRAY = [(0.6, 0.3, 0.2), (0.2, 0.4, 0.6), (0.7, 0.7, 0.7)]


@dataclass(frozen=True)
class Stage:
    """A scene to compare.

    Attributes:
        description: The scene.
        camera: The camera.
        depth: Largest number of segments of a path.
        margin: Relative difference of the means that is expected by design, where the two use different models.
        edges: Number of pixels that may differ more: at silhouettes, where samples are not normally distributed, and
            where tiscene turns interpolated normals of a rough mirror toward the camera and Mitsuba renders black.
        noise: Variance of one path compared to Mitsuba: "alike" where both sample the same way, "less" where tiscene
            samples lights better, "other" where paths are not comparable.
        compensates: False: what rough reflection loses is not compensated in tiscene either.
    """

    description: SceneDescription
    camera: Camera = CAMERA
    depth: int = 4
    margin: float = 0.0
    edges: int = 2
    noise: Literal["alike", "less", "other"] = "alike"
    compensates: bool = True


def room(*lights: Light, textures: tuple[Texture, ...] = ()) -> SceneDescription:
    """Return a Cornell box in three colors with the given lights."""
    meshes, materials = box(GRAY)
    return described(meshes, materials, list(lights), list(textures))


def pedestal(material: Material, *lights: Light) -> SceneDescription:
    """Return a ball of a material above a gray floor and before a wall."""
    floor = quad((-3.0, -0.8, 3.0), (3.0, -0.8, 3.0), (3.0, -0.8, -3.0), (-3.0, -0.8, -3.0))
    wall = quad((-3.0, -0.8, -1.5), (3.0, -0.8, -1.5), (3.0, 3.0, -1.5), (-3.0, 3.0, -1.5), material=1)
    materials = [matte("floor", (0.5, 0.5, 0.5)), matte("wall", (0.6, 0.3, 0.2)), material]
    return described([floor, wall, ball((0.0, -0.1, 0.0), 0.7, 2, 5)], materials, list(lights))


# Both sample disks by their area.
PANEL = DiskLight("panel", "/panel", towards((0.5, 2.5, 1.5), (-0.2, -1.0, -0.6)), (6.0, 5.0, 4.0), 0.75)
ABOVE = towards((0.1, 0.7, 0.3), DOWN)
# Flat lights are close to the ceiling, so that their backs are invisible: in tiscene rays pass through backs.
CEILING = towards((0.1, 0.995, 0.3), DOWN)
BRIGHT = (8.0, 6.0, 4.0)


def sky_image() -> Texture:
    """Return a smooth environment map that is brighter on one side and above."""
    v, u = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(128) + 0.5) / 128, indexing="ij")
    pixels = np.ones((64, 128, 4), np.float32)
    pixels[..., 0] = 0.6 + 0.5 * np.cos(2.0 * np.pi * u) * np.sin(np.pi * v)
    pixels[..., 1] = 0.5 + 0.3 * np.cos(np.pi * v)
    pixels[..., 2] = 0.7 + 0.3 * np.sin(2.0 * np.pi * u) * np.sin(np.pi * v)
    return Texture("sky", pixels, encoding="raw")


def lamps() -> list[Light]:
    """Return 24 small spheres that occlude each other."""
    places = [(x, y, z) for x in (-0.6, 0.0, 0.6) for y in (0.4, 0.8) for z in (-0.6, -0.2, 0.2, 0.6)]
    bright = (3.2, 2.4, 1.6)
    return [SphereLight(f"{k}", f"/{k}", towards(place, DOWN), bright, 0.05) for k, place in enumerate(places)]


def patches(size: int = 8) -> Texture:
    """Return a texture of random colors."""
    pixels = np.random.default_rng(4).random((size, size, 4)).astype(np.float32)
    return Texture("patches", pixels, encoding="raw", wrap_s="clamp", wrap_t="clamp")


def textured() -> SceneDescription:
    """Return a textured floor and wall."""
    floor = quad((-1.5, -0.8, 1.5), (1.5, -0.8, 1.5), (1.5, -0.8, -1.5), (-1.5, -0.8, -1.5))
    wall = quad((-1.5, -0.8, -1.0), (1.5, -0.8, -1.0), (1.5, 1.2, -1.0), (-1.5, 1.2, -1.0))
    return described([floor, wall], [matte("painted", TextureLookup(0))], [PANEL], [patches()])


def instances() -> SceneDescription:
    """Return six instances of one mesh: rotated, scaled, mirrored."""
    scene = pedestal(matte("balls", (0.3, 0.6, 0.3)), PANEL)
    small = ball((0.0, 0.0, 0.0), 0.3, 2, 3)
    placed = []
    for k in range(6):
        matrix = np.eye(4)
        matrix[:3, :3] = np.diag([1.0 + 0.2 * k, 0.6, -1.0 if k % 2 else 0.7])
        turn = 0.7 * k
        matrix[:3, :3] = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]] @ matrix[:3, :3]
        matrix[:3, 3] = (-1.0 + 0.4 * k, -0.3 + 0.1 * k, -0.2 * (k % 3))
        placed.append(Instance(2, 2, matrix))
    meshes: tuple[Mesh, ...] = (*scene.meshes[:2], small)
    return replace(scene, meshes=meshes, instances=(*scene.instances[:2], *placed))


def lantern() -> SceneDescription:
    """Return a box lit by emissive meshes only: a ball, and a scaled and mirrored ball of another color."""
    meshes, materials = box(GRAY)
    lamps = [ball((0.0, 0.0, 0.0), 0.15, 3, 3), ball((0.0, 0.0, 0.0), 0.12, 4, 2)]
    emissive = [
        matte("warm", (0.0, 0.0, 0.0), emissive_color=BRIGHT),
        matte("cold", WHITE, emissive_color=(2.0, 4.0, 9.0)),
    ]
    scene = described([*meshes, *lamps], [*materials, *emissive])
    hung, stretched = np.eye(4), np.diag([2.5, 0.4, -1.5, 1.0])
    hung[:3, 3], stretched[:3, 3] = (-0.1, 0.55, 0.2), (0.45, -0.2, 0.45)
    places = (Instance(len(meshes), len(meshes), hung), Instance(len(meshes) + 1, len(meshes) + 1, stretched))
    return replace(scene, instances=(*scene.instances[: len(meshes)], *places))


def curtain() -> SceneDescription:
    """Return a partially opaque surface in front of a ball and its light."""
    scene = pedestal(matte("ball", (0.3, 0.6, 0.3)), PANEL)
    veil = quad((-0.9, -0.6, 0.9), (0.2, -0.6, 0.9), (0.2, 0.9, 0.9), (-0.9, 0.9, 0.9), material=3)
    lace = matte("lace", (0.6, 0.6, 0.2), opacity=0.4, opacity_mode="presence")
    meshes = [*scene.meshes, veil]
    return described(meshes, [*scene.materials, lace], list(scene.lights))


def globe(material: int, rows: int = 48) -> Mesh:
    """Return the ball of `pedestal` with texture coordinates: u around its axis, v along it."""
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows + 1), np.linspace(0.0, 1.0, 2 * rows + 1), indexing="ij")
    polar, turn = np.pi * (1.0 - v.ravel()), 2.0 * np.pi * u.ravel()
    unit = np.stack([np.sin(polar) * np.sin(turn), np.cos(polar), np.sin(polar) * np.cos(turn)], axis=-1)
    first = (np.arange(1, rows - 1)[:, None] * (2 * rows + 1) + np.arange(2 * rows)).ravel()
    a, b, c, d = first, first + 1, first + 2 * rows + 2, first + 2 * rows + 1
    triangles = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).astype(np.int32)
    return Mesh(
        "globe",
        (0.7 * unit + (0.0, -0.1, 0.0)).astype(np.float32),
        triangles,
        np.full(len(triangles), material, np.int32),
        normals=unit.astype(np.float32),
        uv=np.stack([u.ravel(), v.ravel()], axis=-1).astype(np.float32),
    )


def brushed(*lights: Light) -> SceneDescription:
    """Return a ball of anisotropic metal, smoother along its axis."""
    scene = pedestal(replace(metal(0.3), lobes=ExtendedLobes(anisotropy=0.6)), PANEL, *lights)
    return described([*scene.meshes[:2], globe(2)], [*scene.materials], list(scene.lights))


def window() -> SceneDescription:
    """Return a colored pane in front of a ball."""
    scene = pedestal(matte("ball", (0.3, 0.6, 0.3)), PANEL)
    pane = quad((-0.9, -0.6, 0.9), (0.4, -0.6, 0.9), (0.4, 0.9, 0.9), (-0.9, 0.9, 0.9), material=3)
    colored = replace(clear(0.0), lobes=ExtendedLobes(transmission_color=(0.9, 0.6, 0.3), thin_walled=True))
    return described([*scene.meshes, pane], [*scene.materials, colored], list(scene.lights))


def metal(roughness: float) -> Material:
    """Return a white metal."""
    return Material("metal", diffuse_color=(1.0, 1.0, 1.0), metallic=1.0, roughness=roughness)


def glass(roughness: float) -> Material:
    """Return clear glass."""
    return Material("glass", opacity=0.0, roughness=roughness, ior=1.5)


def clear(roughness: float) -> Material:
    """Return clear glass of a model that says that it transmits."""
    return replace(glass(roughness), opacity_mode="transmission")


LENS = replace(CAMERA, lens_radius=0.08, focus_distance=3.0)

STAGES: dict[str, Callable[[], Stage]] = {
    "rect": lambda: Stage(room(RectLight("l", "/l", CEILING, BRIGHT, 0.6, 0.4)), noise="less"),
    "disk": lambda: Stage(room(DiskLight("l", "/l", CEILING, BRIGHT, 0.3))),
    "sphere": lambda: Stage(room(SphereLight("l", "/l", ABOVE, BRIGHT, 0.15))),
    "cylinder": lambda: Stage(room(CylinderLight("l", "/l", ABOVE, BRIGHT, 0.06, 0.9)), noise="less"),
    # Most of the variance is whether a camera path hits a light.
    "many lamps": lambda: Stage(room(*lamps()), noise="other"),
    "point": lambda: Stage(room(SphereLight("l", "/l", ABOVE, (1.0, 0.8, 0.6), 0.0))),
    "sun": lambda: Stage(room(DistantLight("l", "/l", towards((0, 0, 0), (0.4, -0.5, -1.0)), (3.0, 2.0, 1.0)))),
    "dome": lambda: Stage(room(DomeLight("l", "/l", np.eye(4), (0.6, 0.8, 1.0)))),
    # Mitsuba interpolates the environment map between texel edges, tiscene between texel centers.
    "environment": lambda: Stage(
        room(DomeLight("l", "/l", towards((0, 0, 0), (1.0, 0.2, -1.0)), (1.0, 1.0, 1.0), 0), textures=(sky_image(),)),
        margin=0.015,
    ),
    "textured lamp": lambda: Stage(
        room(RectLight("l", "/l", CEILING, BRIGHT, 1.0, 0.8, 0), textures=(patches(),)),
        margin=0.005,
        noise="less",
    ),
    "emission": lambda: Stage(
        pedestal(matte("emissive", (0.2, 0.2, 0.2), emissive_color=(2.0, 3.0, 1.0)), PANEL), noise="less"
    ),
    "mesh light": lambda: Stage(lantern(), noise="less"),
    # tiscene looks up one texel at a time.
    "texture": lambda: Stage(textured(), margin=0.005, noise="other"),
    "mirror": lambda: Stage(pedestal(metal(0.0), PANEL)),
    # Mitsuba does not compensate the energy loss of rough microfacets: one percent here, three at grazing angles.
    "rough metal": lambda: Stage(pedestal(metal(0.25), PANEL), margin=0.03, edges=8),
    "glass": lambda: Stage(pedestal(glass(0.0), PANEL), depth=10),
    "rough glass": lambda: Stage(pedestal(glass(0.3), PANEL), depth=10, margin=0.03),
    # As for rough metal; tiscene does not compensate all of what anisotropic microfacets lose. The sky leaves nothing
    # black that the ball reflects: there, what is compensated is all of the light.
    "anisotropic metal": lambda: Stage(
        brushed(DomeLight("sky", "/sky", np.eye(4), (0.4, 0.5, 0.6))), margin=0.03, edges=8, noise="other"
    ),
    "anisotropic metal, uncompensated": lambda: Stage(brushed(), noise="other", compensates=False),
    # Mitsuba's pane is perfectly smooth: samples of lights never reach the picture through it.
    "pane": lambda: Stage(window(), depth=10, noise="other"),
    "absorbing glass": lambda: Stage(
        pedestal(replace(clear(0.0), lobes=ExtendedLobes(absorption=(0.5, 1.0, 2.0))), PANEL), depth=10, noise="other"
    ),
    "partially opaque": lambda: Stage(curtain(), depth=12, margin=0.002, noise="other"),
    "instances": lambda: Stage(instances()),
    "depth of field": lambda: Stage(instances(), camera=LENS),
}
FAST = ("cylinder", "mesh light", "texture", "depth of field")

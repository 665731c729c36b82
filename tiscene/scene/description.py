# SPDX-License-Identifier: Apache-2.0
"""What the files said: host arrays, frozen, independent of USD and of any device.

Lengths are meters, angles radians, colors scene-linear Rec.709, matrices map column vectors.
Normals and texture coordinates belong to vertices: a reader splits a vertex wherever they differ between faces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import CameraNotFound
from tiscene.scene.animation import Deformation, InstanceTrack
from tiscene.scene.camera import Camera, Vector3

FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int32]
Matrix = NDArray[np.float64]
Color = tuple[float, float, float]
_BATCH = 1 << 20  # points at a time


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in object space, counter-clockwise seen from outside.

    positions: float32 [n, 3], m. triangles: int32 [m, 3]. normals: float32 [n, 3], unit, or None for flat shading.
    uv: float32 [n, 2] or None. materials: int32 [m], rows of `SceneDescription.materials`.
    second_uv: float32 [n, 2], colors: float32 [n, 4], RGB and opacity: what some materials read, both or neither.
    parts: int32 [m], which of the mesh's parts each triangle is of; None for one part.
    deformation: where the vertices are over time, if they move; `positions` are those of the time that was read.
    """

    name: str
    positions: FloatArray
    triangles: IntArray
    materials: IntArray
    normals: FloatArray | None = None
    uv: FloatArray | None = None
    parts: IntArray | None = None
    deformation: Deformation | None = None
    second_uv: FloatArray | None = None
    colors: FloatArray | None = None

    def corners(self) -> FloatArray:
        """Points [k, 3] whose hull holds the mesh at all times: its vertices, wherever they are."""
        return self.positions if self.deformation is None else self.deformation.positions.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Texture:
    """An image, first row at the top (v = 1). pixels: uint8 or float32 [h, w, 4].

    encoding: "srgb" values are decoded to linear when read; "raw" are used as they are. Alpha is always raw.
    wrap: what lies outside 0..1, per axis; "black" is transparent black.
    copies: smaller ones, see `texture_copies`; None if they are not made yet.
    """

    name: str
    pixels: NDArray[np.uint8] | FloatArray
    encoding: Literal["srgb", "raw"] = "srgb"
    wrap_s: Literal["repeat", "clamp", "mirror", "black"] = "repeat"
    wrap_t: Literal["repeat", "clamp", "mirror", "black"] = "repeat"
    copies: tuple[Texture, ...] | None = None


VERTEX_COLORS = -1


@dataclass(frozen=True)
class TextureLookup:
    """A material input that is read from a texture: `value = pixel[channel] * scale + bias`.

    texture: row of `SceneDescription.textures`; or VERTEX_COLORS, the colors of the mesh's vertices instead of pixels.
    channel: "rgb" or one of "r", "g", "b", "a".
    uv_transform: 2x3 row-major affine map applied to uv before the lookup (UsdTransform2d).
    uv_set: 1 for the mesh's second uv.
    """

    texture: int
    channel: Literal["rgb", "r", "g", "b", "a"] = "rgb"
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    uv_transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    uv_set: Literal[0, 1] = 0


ColorInput = Color | TextureLookup
FloatInput = float | TextureLookup


@dataclass(frozen=True)
class Material:
    """UsdPreviewSurface: its inputs by its names, with its defaults. normal: tangent space, None for none.

    prim_path: on the stage; of a template's file "Chair 01/Looks/Oak"; "" for what stands in where none is bound.
    """

    name: str
    diffuse_color: ColorInput = (0.18, 0.18, 0.18)
    emissive_color: ColorInput = (0.0, 0.0, 0.0)
    use_specular_workflow: bool = False
    specular_color: ColorInput = (0.0, 0.0, 0.0)
    metallic: FloatInput = 0.0
    roughness: FloatInput = 0.5
    clearcoat: FloatInput = 0.0
    clearcoat_roughness: FloatInput = 0.01
    opacity: FloatInput = 1.0
    opacity_mode: Literal["transparent", "presence"] = "transparent"
    opacity_threshold: float = 0.0
    ior: float = 1.5
    normal: TextureLookup | None = None
    prim_path: str = ""


@dataclass(frozen=True)
class Shaping:
    """UsdLux's ShapingAPI: factors of the radiance that a point of a light emits in a direction.

    t is the angle between the direction and the light's axis, -z; c the cosine of that between the direction and the
    light's surface normal. cone_angle: rad; nothing is emitted where t is larger. cone_softness: 0..1, the part of the
    cone over which the edge fades, `1 - smoothstep((1 - softness) * cone_angle, cone_angle, t)`.
    focus: the color `lerp(focus_tint, 1, |c| ** focus)`.
    profile: an IES profile as a texture of scales (row of `SceneDescription.textures`), read at u = p / (2 pi),
    v = 1 - t / pi, with p from +x towards +y.
    """

    cone_angle: float = math.pi
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: Color = (0.0, 0.0, 0.0)
    profile: int | None = None


@dataclass(frozen=True, eq=False)
class Light:
    """Base of the lights. world_from_light: 4x4, rigid (scale is already in the sizes).

    diffuse, specular: multipliers of what materials reflect of it by their diffuse and by their other lobes.
    indirect: multiplier of what it gives to surfaces that the camera sees by way of others.
    shaping: None for all directions alike. casts_shadows: False, nothing keeps its light off anything.
    """

    name: str
    prim_path: str
    world_from_light: Matrix
    _: KW_ONLY
    diffuse: float = 1.0
    specular: float = 1.0
    indirect: float = 1.0
    shaping: Shaping | None = None
    casts_shadows: bool = True


@dataclass(frozen=True, eq=False)
class RectLight(Light):
    """A rectangle in the light's xy plane that emits towards -z. radiance: W/m²/sr; width, height: m."""

    radiance: Color
    width: float
    height: float
    texture: int | None = None


@dataclass(frozen=True, eq=False)
class DiskLight(Light):
    """A disk in the light's xy plane that emits towards -z. radiance: W/m²/sr; radius: m."""

    radiance: Color
    radius: float


@dataclass(frozen=True, eq=False)
class SphereLight(Light):
    """A sphere about the light's origin that emits outwards. radiance: W/m²/sr; radius: m.

    radius 0 is a point: `radiance` is then its intensity, W/sr.
    """

    radiance: Color
    radius: float


@dataclass(frozen=True, eq=False)
class CylinderLight(Light):
    """The side, without the caps, of a cylinder about the light's x axis; emits outwards.

    radiance: W/m²/sr; radius, length: m.
    """

    radiance: Color
    radius: float
    length: float


@dataclass(frozen=True, eq=False)
class DistantLight(Light):
    """Light from infinity travelling along -z. irradiance: W/m² on a plane that faces it; angle: full cone, rad."""

    irradiance: Color
    angle: float = 0.0


@dataclass(frozen=True, eq=False)
class Portal:
    """A rectangle in its own xy plane by which a dome's light enters a room, along -z. No limit to the light, but where
    it is sampled. world_from_portal: 4x4, rigid; width, height: m.
    """

    world_from_portal: Matrix
    width: float
    height: float


@dataclass(frozen=True, eq=False)
class DomeLight(Light):
    """The surroundings. radiance: W/m²/sr, multiplies the latlong texture (None: constant).

    A direction d in light space reads the image at u = (atan2(d.z, d.x) + pi/2) / (2 pi), v = 1 - acos(d.y) / pi, with
    v = 1 the top row: +y is the top, +z the center, +x a quarter from the left (OpenUSD's latlong convention).
    portals: places on whose -z side sample the light through them alone.
    """

    radiance: Color
    texture: int | None = None
    portals: tuple[Portal, ...] = ()


@dataclass(frozen=True)
class SceneObject:
    """A thing with an identity: what one instance label stands for. category: semantic label, "" for none.

    parts: the names of its meshes, and of their subsets, by their number; () for a thing of one part.
    movable: its author made a rigid body of it (UsdPhysics). asset: the name of the asset that it is of, "" for none.
    """

    name: str
    prim_path: str
    category: str = ""
    parts: tuple[str, ...] = ()
    movable: bool = False
    asset: str = ""


@dataclass(frozen=True, eq=False)
class Instance:
    """A placed mesh. mesh, object: rows of `SceneDescription.meshes` and `.objects`. world_from_object: float64 4x4.

    part: number of the first of its object's parts that it shows; `Mesh.parts` counts on from there.
    collides: False for what its author lets everything pass through (UsdPhysics).
    """

    mesh: int
    object: int
    world_from_object: Matrix
    part: int = 0
    collides: bool = True


@dataclass(frozen=True, eq=False)
class Collider(Instance):
    """What things collide with and nobody sees: a UsdPhysics collider of purpose guide, or one that is invisible.

    object: -1 if nothing is drawn of the thing that it is part of.
    """

    prim_path: str = ""


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """A stage at one time code, or an object template in its own space.

    colliders: those that are not drawn. tracks: which of the instances move, come and go by themselves.
    """

    name: str
    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = ()
    textures: tuple[Texture, ...] = ()
    instances: tuple[Instance, ...] = ()
    objects: tuple[SceneObject, ...] = ()
    lights: tuple[Light, ...] = ()
    cameras: tuple[Camera, ...] = ()
    up_axis: Literal["Y", "Z"] = "Y"
    templates: tuple[Template, ...] = field(default=())
    colliders: tuple[Collider, ...] = ()
    tracks: tuple[InstanceTrack, ...] = ()

    @property
    def is_dark(self) -> bool:
        """Whether nothing gives light."""
        return not self.lights and all(material.emissive_color == (0.0, 0.0, 0.0) for material in self.materials)

    @property
    def up(self) -> Vector3:
        """The direction that is up."""
        return (0.0, 1.0, 0.0) if self.up_axis == "Y" else (0.0, 0.0, 1.0)

    def camera(self, name: str | None = None) -> Camera:
        """The camera of that name; None: the first, else one that sees everything. Raises CameraNotFound."""
        for each in self.cameras:
            if name in (None, each.name):
                return each
        if name is not None:
            raise CameraNotFound("camera", name, [each.name for each in self.cameras], f" in scene {self.name!r}")
        (a, b, c), (d, e, f) = self.bounds().tolist()
        return Camera.framing((a, b, c), (d, e, f), self.up)

    def bounds(self) -> NDArray[np.float64]:
        """The box around every vertex of what is drawn, [2, 3]: lowest and highest corner, m; zeros if empty."""
        if not self.instances:
            return np.zeros((2, 3))
        matrices = np.array([instance.world_from_object for instance in self.instances])
        every = mesh_boxes(self.meshes, [instance.mesh for instance in self.instances], matrices)
        low, high = every[:, 0].min(axis=0), every[:, 1].max(axis=0)
        return np.stack([low, high]) if np.isfinite(low).all() else np.zeros((2, 3))


def mesh_boxes(meshes: Sequence[Mesh], rows: Sequence[int], matrices: Matrix) -> NDArray[np.float64]:
    """[n, 2, 3]: the box around the vertices of each of the meshes `rows`, mapped by its matrix [n, 4, 4]; inf, -inf
    for one without any."""
    result = np.empty((len(rows), 2, 3))
    result[:, 0], result[:, 1] = np.inf, -np.inf
    chosen = np.asarray(rows, np.int64)
    order = np.argsort(chosen, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(chosen[order])) + 1) if len(order) else ():
        positions = np.ascontiguousarray(meshes[chosen[group[0]]].corners().T, np.float64)  # [3, points]
        count = positions.shape[1]
        step = max(1, _BATCH // max(count, 1))
        for start in range(0, len(group) if count else 0, step):
            some = group[start : start + step]
            mapped = matrices[some, :3, :3] @ positions
            result[some, 0] = mapped.min(axis=2) + matrices[some, :3, 3]
            result[some, 1] = mapped.max(axis=2) + matrices[some, :3, 3]
    return result


@dataclass(frozen=True, eq=False)
class Template:
    """Something that can be spawned. description: its meshes, about the template's origin; category: its label."""

    name: str
    category: str
    description: SceneDescription

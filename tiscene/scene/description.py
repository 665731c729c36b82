# SPDX-License-Identifier: Apache-2.0
"""SceneDescription: a stage as host arrays, frozen, independent of USD and of any device.

Lengths are meters, angles radians, colors scene-linear Rec.709; matrices map column vectors. Normals and texture
coordinates belong to vertices: a reader splits a vertex wherever they differ between faces.

The classes of lights and materials are defined in `light_description` and `material_description`, and are names of this
module too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import CameraNotFound
from tiscene.scene.animation import ColorTrack, Deformation, InstanceTrack
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.input_track import InputTrack
from tiscene.scene.light_description import CylinderLight as CylinderLight
from tiscene.scene.light_description import DiskLight as DiskLight
from tiscene.scene.light_description import DistantLight as DistantLight
from tiscene.scene.light_description import DomeLight as DomeLight
from tiscene.scene.light_description import Light as Light
from tiscene.scene.light_description import Matrix as Matrix
from tiscene.scene.light_description import Portal as Portal
from tiscene.scene.light_description import RectLight as RectLight
from tiscene.scene.light_description import Shaping as Shaping
from tiscene.scene.light_description import SphereLight as SphereLight
from tiscene.scene.material_description import VERTEX_COLORS as VERTEX_COLORS
from tiscene.scene.material_description import Color as Color
from tiscene.scene.material_description import ColorInput as ColorInput
from tiscene.scene.material_description import ExtendedLobes as ExtendedLobes
from tiscene.scene.material_description import FloatInput as FloatInput
from tiscene.scene.material_description import Material as Material
from tiscene.scene.material_description import Texture as Texture
from tiscene.scene.material_description import TextureLookup as TextureLookup
from tiscene.scene.room_volume import RoomVolume

FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int32]
EARTH = 9.81  # m/s2: gravity of stages without their own
_FLAT = 0.01  # height of a flat ground, of its width
_GROUND = 3.0  # width of a ground that no picture is framed by, of the diagonal of all else
_MAX_POINTS = 1 << 20  # that `mesh_boxes` transforms at once


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in object space, counter-clockwise seen from outside.

    Attributes:
        name: For messages.
        positions: float32 [n, 3], m, at the time code that was read.
        triangles: int32 [m, 3], rows of `positions`.
        materials: int32 [m], rows of `SceneDescription.materials`.
        normals: float32 [n, 3], unit. None: flat shading.
        uv: float32 [n, 2]. None: none.
        parts: int32 [m], the part of the mesh that each triangle belongs to. None: one part.
        deformation: Vertices over time. None: they do not move.
        second_uv: float32 [n, 2], read by some materials. None exactly if `colors` is.
        colors: float32 [n, 4], RGB and opacity of vertices, read by some materials. None: none.
        link_class: Number of the meshes that the same lights light and shadow, where a light has `lit` or `shadowing`.
            0 also holds what is spawned.
        shape: Number of the shape whose topology changes that this mesh is at some frames, 1 and up: it is on the
            device only while a frame needs it. 0: always.
        origin: Origin of the prim's space in this one, m. Not 0 where points far from it are kept relative to their
            center; both spaces have the same axes.
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
    link_class: int = 0
    origin: Vector3 = (0.0, 0.0, 0.0)
    shape: int = 0

    def corners(self) -> FloatArray:
        """Return points [k, 3] whose convex hull holds the mesh at all times."""
        return self.positions if self.deformation is None else self.deformation.corners()


@dataclass(frozen=True)
class SceneObject:
    """An object with an identity: what one instance label stands for.

    Attributes:
        name: Unique in the scene.
        prim_path: Path on the stage.
        category: Semantic label. "": none.
        parts: Names of its meshes and of their subsets, by part number. (): an object of one part.
        movable: Whether its author made it a rigid body (UsdPhysics).
        asset: Name of the asset that it is an instance of. "": none.
        world_from_object: float64 4x4, m, of its prim or its point of an instancer. None: of its first mesh.
    """

    name: str
    prim_path: str
    category: str = ""
    parts: tuple[str, ...] = ()
    movable: bool = False
    asset: str = ""
    world_from_object: Matrix | None = field(default=None, compare=False)


@dataclass(frozen=True, eq=False)
class Instance:
    """A placed mesh.

    Attributes:
        mesh: Row of `SceneDescription.meshes`.
        object: Row of `SceneDescription.objects`.
        world_from_object: float64 4x4, m.
        part: Number of the first of the object's parts that it shows; `Mesh.parts` counts on from there.
        collides: False if the stage excludes it from collisions (UsdPhysics).
        color: float32 [4], RGB and opacity that take the place of those of the mesh's vertices; NaN where they do not.
            None: they do not.
    """

    mesh: int
    object: int
    world_from_object: Matrix
    part: int = 0
    collides: bool = True
    color: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Collider(Instance):
    """A mesh that objects collide with and that is not rendered: a UsdPhysics collider that is a guide or invisible.

    Attributes:
        object: Row of `SceneDescription.objects`. -1: no part of its object is rendered.
        prim_path: Path on the stage.
    """

    prim_path: str = ""


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """A stage at one time code, or an object template in its own space.

    Attributes:
        name: Of the scene or template.
        instances: What is rendered.
        templates: Templates that are defined on the stage.
        colliders: Meshes for collisions alone.
        tracks: Instances that move, appear and disappear by the stage's own time samples.
        color_tracks: Colors of instances over time.
        object_tracks: Transforms of objects over time, by their rows. They say where objects are, not what is drawn.
        material_tracks: Inputs of materials that vary over time.
        light_tracks: Inputs of lights that vary over time. Poses only of lights that move within a template.
        rooms: Volumes of rooms.
        resolution: Width and height of the image that the stage's RenderSettings ask for, px. None: none.
        camera_paths: Prim paths of the cameras. Empty: unknown.
        gravity: Of the stage's PhysicsScene, m/s2, world. None: that of the earth.
        moved: Boxes of the prims that a scenario moves, as authored: [2, 3], lowest and highest corner, m.
        has_lights_off: Whether lights are authored that emit nothing or are never visible; they are not in `lights`.
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
    object_tracks: tuple[InstanceTrack, ...] = ()
    rooms: tuple[RoomVolume, ...] = ()
    resolution: tuple[int, int] | None = None
    material_tracks: tuple[InputTrack, ...] = ()
    light_tracks: tuple[InputTrack, ...] = ()
    camera_paths: tuple[str, ...] = ()
    gravity: Vector3 | None = None
    moved: tuple[NDArray[np.float64], ...] = ()
    has_lights_off: bool = False
    color_tracks: tuple[ColorTrack, ...] = ()

    @property
    def is_dark(self) -> bool:
        """Whether there is neither a light nor an emissive material at any time."""
        emission = [material.emissive_color for material in self.materials]
        emission += [color for track in self.material_tracks for color in track.values("emissive_color")]
        return not self.lights and all(color == (0.0, 0.0, 0.0) for color in emission)

    @property
    def up(self) -> Vector3:
        """The unit vector of the up axis."""
        return (0.0, 1.0, 0.0) if self.up_axis == "Y" else (0.0, 0.0, 1.0)

    @property
    def camera_names(self) -> dict[str, str]:
        """Names of the cameras by prim path."""
        return {path: each.name for path, each in zip(self.camera_paths, self.cameras, strict=False)}

    def camera(self, name: str | None = None) -> Camera:
        """Return a camera by name or prim path. None: the first, or one that frames the scene.

        Raises:
            CameraNotFound: There is no such camera.
        """
        name = None if name is None else self.camera_names.get(name, name)
        for each in self.cameras:
            if name in (None, each.name):
                return each
        if name is not None:
            hint = "" if self.cameras else "It has none: give no name, or a `Camera`."
            known = [each.name for each in self.cameras]
            raise CameraNotFound("camera", name, known, f" in scene {self.name!r}", hint)
        (a, b, c), (d, e, f) = self._bounds_without_ground().tolist()
        return Camera.framing((a, b, c), (d, e, f), self.up)

    def bounds(self) -> NDArray[np.float64]:
        """Return the bounding box of all instances, [2, 3]: lowest and highest corner, m; zeros if there are none."""
        matrices = [each.world_from_object for each in self.instances]
        return bounding_box(self, [each.mesh for each in self.instances], matrices)

    def _bounds_without_ground(self) -> NDArray[np.float64]:
        """Return the box of all instances and of what a scenario moves, without grounds that would make it tiny."""
        matrices = np.array([each.world_from_object for each in self.instances]).reshape(-1, 4, 4)
        boxes = mesh_boxes(self.meshes, [each.mesh for each in self.instances], matrices)
        boxes = np.concatenate([boxes, np.array(self.moved).reshape(-1, 2, 3)])
        sides = boxes[:, 1] - boxes[:, 0]
        up = self.up.index(1.0)
        width = np.delete(sides, up, axis=1).max(axis=1)
        is_flat = sides[:, up] <= _FLAT * width
        size = np.linalg.norm(np.diff(_union(boxes[~is_flat]), axis=0))
        return _union(boxes[~is_flat | (width <= _GROUND * size)] if size > 0.0 else boxes)


def mesh_boxes(meshes: Sequence[Mesh], rows: Sequence[int], matrices: Matrix) -> NDArray[np.float64]:
    """Return the bounding boxes of transformed meshes.

    Args:
        meshes: The meshes.
        rows: The mesh of each box, n rows of `meshes`.
        matrices: [n, 4, 4], the transform of each.

    Returns:
        [n, 2, 3], lowest and highest corner; inf and -inf for a mesh without vertices.
    """
    result = np.empty((len(rows), 2, 3))
    result[:, 0], result[:, 1] = np.inf, -np.inf
    chosen = np.asarray(rows, np.int64)
    order = np.argsort(chosen, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(chosen[order])) + 1) if len(order) else ():
        positions = np.ascontiguousarray(meshes[chosen[group[0]]].corners().T, np.float64)  # [3, points]
        count = positions.shape[1]
        step = max(1, _MAX_POINTS // max(count, 1))
        for start in range(0, len(group) if count else 0, step):
            batch = group[start : start + step]
            mapped = matrices[batch, :3, :3] @ positions
            result[batch, 0] = mapped.min(axis=2) + matrices[batch, :3, 3]
            result[batch, 1] = mapped.max(axis=2) + matrices[batch, :3, 3]
    return result


def bounding_box(
    description: SceneDescription, meshes: Sequence[int], matrices: Sequence[Matrix]
) -> NDArray[np.float64]:
    """Return the bounding box of meshes, each transformed by its 4x4 matrix: [2, 3], m; zeros if there are none."""
    boxes = mesh_boxes(description.meshes, meshes, np.array(matrices).reshape(-1, 4, 4))
    return _union(boxes)


def _union(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the box around boxes [n, 2, 3]: [2, 3]; zeros if there are none."""
    low, high = boxes[:, 0].min(axis=0, initial=np.inf), boxes[:, 1].max(axis=0, initial=-np.inf)
    return np.stack([low, high]) if np.isfinite(low).all() else np.zeros((2, 3))


@dataclass(frozen=True, eq=False)
class Template:
    """An object that can be spawned.

    Attributes:
        name: Its name.
        category: Semantic label.
        description: Its meshes, relative to the template's origin.
    """

    name: str
    category: str
    description: SceneDescription

# SPDX-License-Identifier: Apache-2.0
"""Views: the cameras of a frame and its neighbors with the image size, as a device array; camera rays.

Pixel coordinates are (x right, y down) with pixel *centers* at integers: an image spans -0.5 .. width - 0.5.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics.argument_checks import integer
from tiscene.device.kernel_types import Template
from tiscene.device.memory import device_array
from tiscene.device.restart import cached_on_device
from tiscene.errors import ArgumentError
from tiscene.render.sampling.cube import FACE_ANGLE, FACES, direction_to
from tiscene.render.sampling.sobol import pixel_order
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS
from tiscene.scene.walking import Axes

VIEW_COLUMNS = 23
POSITION, RIGHT, UP, FORWARD, TANGENT, LENS_RADIUS, FOCUS_DISTANCE, BACKGROUND = 0, 3, 6, 9, 12, 13, 14, 15
HALF_HEIGHT, CENTER, CUBE = 18, 19, 22
SKY = (-1.0, -1.0, -1.0)  # as View.background: show the lights at infinity
_ORDERED = 256  # pixels of a CubeView along a side of the squares in which random numbers have the order of an image
MAX_SIZE = 16384  # px, of a side of a stream's images
MAX_PIXELS = 1 << 27  # of an image; kernels count the elements of arrays, up to 15 a pixel, in int32


def check_image_size(width: int, height: int) -> None:
    """Raise an ArgumentError unless an image of this size, px, can be rendered."""
    if width < 1 or height < 1:
        raise ArgumentError(f"image of {width}x{height} pixels: width and height must be at least 1")
    if width * height > MAX_PIXELS:
        raise ArgumentError(
            f"image of {width}x{height} pixels: at most {MAX_PIXELS} pixels, for example 16384x8192, are possible; "
            "reduce width or height"
        )


def image_size(width: int | None, height: int | None, resolution: tuple[int, int] | None = None) -> tuple[int, int]:
    """Return the size of the images: what the caller gave, completed from the stage's resolution, else 256 x 192.

    Raises:
        ArgumentError: The size is no number of pixels, or too large to be rendered.
    """
    if resolution is not None and width is None:
        width = resolution[0] if height is None else max(1, round(height * resolution[0] / resolution[1]))
    if resolution is not None and height is None and width is not None:
        height = max(1, round(width * resolution[1] / resolution[0]))
    width, height = 256 if width is None else width, 192 if height is None else height
    size = integer(width, "width", 1, MAX_SIZE), integer(height, "height", 1, MAX_SIZE)
    check_image_size(*size)
    return size


@dataclass(frozen=True)
class View:
    """The cameras at frames k-1, k and k+1, and the image size.

    Attributes:
        previous: Camera at k-1.
        current: Camera at k.
        next: Camera at k+1.
        width: Image width, px.
        height: Image height, px.
        ambient: Radiance of a white surface that `rgb` adds to the rendered one: ambient light without a source.
        background: Radiance shown where camera rays hit nothing, in place of lights at infinity, which still
            illuminate the scene; SKY shows them.
        is_dynamic: Whether the camera moves at other times, even if it stands still around this frame.
        walks: World axes (0, 1, 2) along which it is known to walk at other times.
        zooms: Whether its field of view changes, at this frame or at other times.

    Raises:
        ArgumentError: If the image is empty or too large.
    """

    previous: Camera
    current: Camera
    next: Camera
    width: int
    height: int
    ambient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    background: tuple[float, float, float] = SKY
    is_dynamic: bool = False
    walks: Axes = Axes()  # noqa: RUF009  # immutable
    zooms: bool = False
    _device: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_image_size(self.width, self.height)
        for name in ("previous", "current", "next"):
            object.__setattr__(self, name, getattr(self, name).framed(self.width / self.height))
        zooms = self.zooms or len({camera.vertical_fov for camera in self.cameras}) > 1
        object.__setattr__(self, "zooms", zooms)

    @property
    def cameras(self) -> tuple[Camera, Camera, Camera]:
        """The cameras, indexed by PREVIOUS, CURRENT, NEXT."""
        return self.previous, self.current, self.next

    @property
    def is_still(self) -> bool:
        """Whether the camera stands still around the frame, and its lens shows the same."""
        return self.previous.optics == self.current.optics == self.next.optics

    @property
    def pinhole_moves(self) -> bool:
        """Whether the camera is a pinhole that moves or zooms, around the frame or at other times.

        A camera that stops is seen as it was while it moved: nothing else has to be traced first, and the picture does
        not change when it stops.
        """
        return self.is_pinhole and (self.is_dynamic or bool(self.walks) or self.zooms or not self.is_still)

    @property
    def is_pinhole(self) -> bool:
        """Whether all rays meet in the camera's center."""
        return self.current.lens_radius == 0.0 and not self.orthographic

    def rows(self) -> NDArray[np.float32]:
        """Return the cameras as float32 [3, VIEW_COLUMNS], one row per time.

        Columns: position 0-2 (of an orthographic camera the image's center), right 3-5, up 6-8, forward 9-11,
        tan(vertical_fov / 2) 12, lens radius 13, focus distance 14, background 15-17, half of an orthographic camera's
        view height 18, the image's center 19-21 at a depth of 1, relative to the camera, zero 22. Either the tangent or
        the half height is 0: a pixel selects the direction of a ray, or its origin.
        """
        rows = np.zeros((3, VIEW_COLUMNS), np.float32)
        for time in (PREVIOUS, CURRENT, NEXT):
            camera = self.cameras[time]
            right, up, backward = camera.axes().T
            orthographic = camera.orthographic_height is not None
            across, above = camera.image_center(1.0)
            offset = across * right + above * up
            rows[time] = [
                *(np.add(camera.position, offset) if orthographic else camera.position),
                *right,
                *up,
                *-backward,
                0.0 if orthographic else np.tan(0.5 * camera.vertical_fov),
                camera.lens_radius,
                camera.focus_distance,
                *self.background,
                0.5 * (camera.orthographic_height or 0.0),
                *(-backward if orthographic else offset - backward),
                0.0,
            ]
        return rows

    def array(self) -> Any:
        """Return `rows` as a device array, the same one at every call."""
        if "rows" not in self._device:
            self._device["rows"] = _uploaded(self.rows().tobytes())
        return self._device["rows"]

    def places(self, pixels: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the places of pixels in the order of random numbers, see `pixel_order`."""
        return pixel_order(self.width, self.height)[pixels]

    def camera_from_world(self) -> NDArray[np.float64]:
        """Return per time the matrix from world to camera coordinates (x right, y down, z forward), [3, 3, 4], m.

        The z axis passes through the image's center: see `Camera.image_from_camera`.
        """
        matrices = np.empty((3, 3, 4))
        for time in (PREVIOUS, CURRENT, NEXT):
            world_from_camera = self.cameras[time].world_from_camera()
            rotation = world_from_camera[:3, :3].T
            matrices[time, :, :3] = rotation
            matrices[time, :, 3] = -rotation @ world_from_camera[:3, 3]
            if any(self.cameras[time].aperture_offset):
                image_from_camera = self.cameras[time].image_from_camera()
                matrices[time] = image_from_camera[:3, :3] @ matrices[time]
                matrices[time, :, 3] += image_from_camera[:3, 3]
        return matrices

    def focal_lengths(self) -> NDArray[np.float64]:
        """Return the focal length per time, [3], px; of an orthographic camera px per meter."""
        return np.array([camera.pixels(self.height) for camera in self.cameras])

    @property
    def orthographic(self) -> bool:
        """Whether the current camera is orthographic."""
        return self.current.orthographic_height is not None


@dataclass(frozen=True)
class CubeView:
    """All that one point sees: the faces of a cube around it, below each other in one image, see `sampling.cube`.

    Attributes:
        center: The point, world, m.
        size: Pixels along a side of a face.
        margin: Width of a margin of each face, which continues its plane, px.
        background: As of a `View`.
    """

    center: Vector3
    size: int
    margin: int = 0
    background: tuple[float, float, float] = SKY

    @property
    def width(self) -> int:
        """Image width, px."""
        return self.size + 2 * self.margin

    @property
    def height(self) -> int:
        """Image height, px."""
        return FACES * self.width

    def rows(self) -> NDArray[np.float32]:
        """Return rows as of a `View`, all equal; 12 has the angle of half the height of all faces, 22 has `size`."""
        row = np.zeros(VIEW_COLUMNS, np.float32)
        row[POSITION : POSITION + 3], row[BACKGROUND : BACKGROUND + 3] = self.center, self.background
        row[TANGENT], row[CUBE] = 0.5 * self.height * FACE_ANGLE / self.size, self.size
        return np.tile(row, (3, 1))

    def array(self) -> Any:
        """Return `rows` as a device array."""
        return _uploaded(self.rows().tobytes())

    def places(self, pixels: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the places of pixels in the order of random numbers: square by square, in each as `pixel_order`."""
        y, x = np.divmod(pixels, self.width)
        square = y // _ORDERED * -(-self.width // _ORDERED) + x // _ORDERED
        within = pixel_order(_ORDERED, _ORDERED)[y % _ORDERED * _ORDERED + x % _ORDERED]
        places: NDArray[np.int32] = square * _ORDERED**2 + within
        return places


@cached_on_device(maxsize=16)
def _uploaded(rows: bytes) -> Any:
    """Upload the rows of a view; a static camera has one array for all frames."""
    array = device_array(ti.f32, (3, VIEW_COLUMNS))
    array.from_numpy(np.frombuffer(rows, np.float32).reshape(3, VIEW_COLUMNS))
    return array


@ti.func
def view_vector(view: Template, time: ti.i32, column: ti.i32) -> ti.math.vec3:
    """Read three columns of a view's row."""
    return ti.math.vec3(view[time, column], view[time, column + 1], view[time, column + 2])


@ti.func
def camera_ray(view: Template, time: ti.i32, x: ti.f32, y: ti.f32, width: ti.i32, height: ti.i32):
    """Return origin and unit direction, world, of the ray through the fractional pixel coordinates (x, y).

    The camera is a pinhole or orthographic; rays of the latter start in the camera's plane. A CubeView has rays in all
    directions.
    """
    scale = 2.0 * (view[time, TANGENT] + view[time, HALF_HEIGHT]) / height
    right = (x - 0.5 * (width - 1)) * scale
    down = (y - 0.5 * (height - 1)) * scale
    origin = view_vector(view, time, POSITION)
    direction = view_vector(view, time, CENTER)
    if view[time, HALF_HEIGHT] > 0.0:
        origin = origin + right * view_vector(view, time, RIGHT) - down * view_vector(view, time, UP)
    elif view[time, CUBE] > 0.0:
        size = ti.cast(view[time, CUBE], ti.i32)
        face, margin = ti.floor((y + 0.5) / width, ti.i32), (width - size) // 2
        direction = direction_to(face, y + 0.5 - face * width - margin, x + 0.5 - margin, size)
    else:
        direction = direction + right * view_vector(view, time, RIGHT) - down * view_vector(view, time, UP)
    return origin, direction.normalized()

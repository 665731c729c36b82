# SPDX-License-Identifier: Apache-2.0
"""Camera: a pose, a lens and an exposure. It looks along its -z axis with +y up, as a UsdGeomCamera does."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import LARGEST, is_number, is_series, is_unicode
from dynamics.rotation import matrix_from_quaternion
from tiscene.errors import ArgumentError
from tiscene.scene.animation import quaternions
from tiscene.scene.lens_keyframes import LensKeyframes

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
_CONFORM = ("expandAperture", "cropAperture", "adjustApertureHeight")
_SAME_ASPECT = 1e-6  # relative; apertures are single-precision numbers
_LENGTHS = ("lens_radius", "focus_distance", "near", "far")


@dataclass(frozen=True)
class Camera:
    """A pinhole, thin-lens or orthographic camera.

    Attributes:
        position: m, world.
        rotation: Unit quaternion (w, x, y, z); other quaternions are normalized.
        vertical_fov: Vertical field of view, rad, 0..pi. Unused by an orthographic camera.
        name: Its name.
        lens_radius: Radius of the aperture, m. 0: a pinhole, with everything in focus.
        focus_distance: Distance of the plane in focus along the optical axis, m.
        near: Near plane of the frustum that moving objects are kept in, m. Nothing is clipped in the image.
        far: Its far plane, m.
        exposure: Stops; radiance is multiplied by 2**exposure. None: metered at frame 0.
        orthographic_height: Height of the visible region of an orthographic camera, m; it sees what is in front of its
            position. None: a perspective camera.
        shutter_open: Frames from the frame's own time, -1..1. Color is averaged while the shutter is open (motion
            blur); labels show the frame's own time.
        shutter_close: Frames from the frame's own time. Equal to `shutter_open`: no motion blur, and color shows the
            frame's own time too.
        aspect: Width / height of the aperture that `vertical_fov` or `orthographic_height` is the height of. `conform`
            says how images of another shape are framed. None: images of any shape have that height.
        conform: OpenUSD's aspectRatioConformPolicy: "expandAperture" shows at least the aperture, "cropAperture" at
            most the aperture, "adjustApertureHeight" its full width.
        aperture_offset: Offset of the image's center from the optical axis, right and up: tangents of angles (offset of
            the aperture / focal length) of a perspective camera, m of an orthographic one. Lines stay as they are in a
            picture without an offset, unlike in that of a turned camera.
        dynamic: Motion of the camera, any `dynamics.Dynamic`. None: a fixed camera.
        lens: Values of the other attributes over time, but for the pose: zooms, focus pulls. None: a fixed lens.
    """

    position: Vector3 = (0.0, 1.6, 4.0)
    rotation: Quaternion = (1.0, 0.0, 0.0, 0.0)
    vertical_fov: float = math.radians(60.0)
    name: str = "Camera"
    lens_radius: float = 0.0
    focus_distance: float = 1.0
    near: float = 0.1
    far: float = 1000.0
    exposure: float | None = None
    orthographic_height: float | None = None
    shutter_open: float = 0.0
    shutter_close: float = 0.0
    aspect: float | None = None
    conform: str = "expandAperture"
    aperture_offset: tuple[float, float] = (0.0, 0.0)
    dynamic: Any = field(default=None, hash=False)
    lens: LensKeyframes | None = field(default=None, hash=False)

    def __post_init__(self) -> None:
        def refuse(name: str, rule: str) -> ArgumentError:
            return ArgumentError(f"camera {self.name!r}: {name}={getattr(self, name)!r}: {rule}")

        if not isinstance(self.name, str) or not is_unicode(self.name):
            raise refuse("name", "must be a string without lone surrogates")
        for name, count in (("position", 3), ("rotation", 4), ("aperture_offset", 2)):
            if not _are_numbers(getattr(self, name), count):
                if name == "rotation":
                    raise refuse(name, "must be a quaternion (w, x, y, z); `Camera.look_at` makes a camera of a target")
                raise refuse(name, f"must be finite numbers, {count} of them")
            object.__setattr__(self, name, tuple(float(component) for component in getattr(self, name)))
        if max(map(abs, self.position)) > LARGEST:
            raise refuse("position", f"must be numbers of at most {LARGEST:g}")
        optional = ("exposure", "orthographic_height", "aspect")
        for name in (*_LENGTHS, "vertical_fov", *optional, "shutter_open", "shutter_close"):
            if name in optional and getattr(self, name) is None:
                continue
            if not is_number(getattr(self, name)):
                raise refuse(name, "must be a number")
            if not _are_numbers((getattr(self, name),), 1):
                raise refuse(name, "must be finite")
            object.__setattr__(self, name, float(getattr(self, name)))
        norm = math.sqrt(sum(component * component for component in self.rotation))
        if not 1e-9 <= norm <= LARGEST:
            raise refuse("rotation", "is not a quaternion (w, x, y, z)")
        # A unit quaternion keeps its bits, so that a camera that is saved and loaded is equal.
        scale = 1.0 if abs(norm - 1.0) < 1e-14 else norm
        object.__setattr__(self, "rotation", tuple(component / scale for component in self.rotation))
        if not 0.0 < self.vertical_fov < math.pi:
            raise refuse("vertical_fov", "must lie between 0 and pi radians")
        if self.lens_radius < 0.0:
            raise refuse("lens_radius", "must be 0 m or more")
        if self.focus_distance <= 0.0:
            raise refuse("focus_distance", "must be greater than 0 m")
        if self.orthographic_height is not None and self.orthographic_height <= 0.0:
            raise refuse("orthographic_height", "must be greater than 0 m")
        if self.orthographic_height is not None and self.lens_radius > 0.0:
            raise refuse("lens_radius", "an orthographic camera has none")
        if self.aspect is not None and self.aspect <= 0.0:
            raise refuse("aspect", "must be greater than 0")
        if self.conform not in _CONFORM:
            raise refuse("conform", f"must be one of {', '.join(_CONFORM)}")
        if not -1.0 <= self.shutter_open <= self.shutter_close <= 1.0:
            raise refuse("shutter_open", f"must be -1 <= open <= close <= 1 frames, shutter_close={self.shutter_close}")
        if not 0.0 < self.near < self.far:
            raise refuse("near", f"must be 0 < near < far, far={self.far}")
        if self.lens is not None:
            self._check_lens(self.lens)

    def _check_lens(self, lens: Any) -> None:
        """Raise an ArgumentError if keyframes of the lens do not fit the camera."""
        if not isinstance(lens, LensKeyframes):
            raise ArgumentError(f"camera {self.name!r}: lens={lens!r}: must be LensKeyframes or None")
        if lens.orthographic_height and self.orthographic_height is None:
            text = "lens.orthographic_height: the camera is a perspective one; give it an orthographic_height too"
            raise ArgumentError(f"camera {self.name!r}: {text}")
        for time, values in zip(lens.times, lens.moments, strict=True):
            try:
                replace(self, lens=None, **values)
            except ArgumentError as error:
                raise ArgumentError(f"{error}, of its lens at {time:g} s") from error

    @classmethod
    def look_at(cls, position: Vector3, target: Vector3, up: Vector3 = (0.0, 1.0, 0.0), **others: Any) -> Camera:
        """Return a camera that sees a target in the center of its image.

        Args:
            position: m, world.
            target: m, world.
            up: Direction that points up in the image.
            others: The other attributes.

        Raises:
            ArgumentError: The three do not span a plane, or an attribute is invalid.
        """
        for name, value in (("position", position), ("target", target), ("up", up)):
            if not _are_numbers(value, 3):
                raise ArgumentError(f"look_at: {name}={value!r}: must be finite numbers, 3 of them")
        backward = np.subtract(position, target, dtype=np.float64)
        right = np.cross(up, backward)
        if np.linalg.norm(right) < 1e-9:
            raise ArgumentError(
                f"look_at: position={position}, target={target} and up={up} do not span a plane; choose another up"
            )
        backward /= np.linalg.norm(backward)
        right /= np.linalg.norm(right)
        axes = np.column_stack([right, np.cross(backward, right), backward])
        return cls(position=position, rotation=quaternion_from_matrix(axes), **others)

    @classmethod
    def framing(cls, low: Vector3, high: Vector3, up: Vector3 = (0.0, 1.0, 0.0), **others: Any) -> Camera:
        """Return a camera that sees a whole bounding box, from in front, above and the right.

        Args:
            low: Lowest corner, m.
            high: Highest corner, m.
            up: (0, 1, 0) or (0, 0, 1).
            others: The other attributes.
        """
        center = 0.5 * np.add(low, high, dtype=np.float64)
        radius = max(0.5 * float(np.linalg.norm(np.subtract(high, low))), 1e-3)
        vertical = np.asarray(up, dtype=np.float64)
        front = np.array([0.0, 0.0, 1.0]) if vertical[1] else np.array([0.0, -1.0, 0.0])
        direction = front + 0.6 * np.cross(vertical, front) + 0.5 * vertical
        distance = radius / math.sin(0.5 * others.get("vertical_fov", math.radians(60.0)))
        position = center + direction / np.linalg.norm(direction) * distance
        return cls.look_at(tuple(position), tuple(center), up, **others)

    def with_pose(self, position: Vector3, rotation: Quaternion) -> Camera:
        """Return the camera with another position, m, and rotation."""
        return replace(self, position=position, rotation=rotation)

    def at(self, seconds: float) -> Camera:
        """Return the camera with its lens at a time, s, fixed; its pose and `dynamic` stay as they are."""
        return self if self.lens is None else replace(self, lens=None, **self.lens.at(seconds))

    def fixed(self, **values: Any) -> Camera:
        """Return the camera with other values, which then do not vary over time."""
        return replace(self, lens=self.lens and self.lens.without(values), **values)

    @property
    def optics(self) -> tuple[Any, ...]:
        """What the image depends on. Two cameras with equal optics show the same, in different exposures perhaps."""
        framing = self.vertical_fov, self.orthographic_height, self.aspect, self.conform, self.aperture_offset
        return self.position, self.rotation, framing, self.lens_radius, self.lens_radius and self.focus_distance

    def framed(self, aspect: float) -> Camera:
        """Return the camera as images of one shape show it, with the height that its `conform` policy gives.

        Args:
            aspect: Width / height of the images.
        """
        if self.aspect is None:
            return self
        ratio = self.aspect / aspect
        if abs(ratio - 1.0) < _SAME_ASPECT:
            ratio = 1.0
        factor = {"expandAperture": max(1.0, ratio), "cropAperture": min(1.0, ratio)}.get(self.conform, ratio)
        if factor == 1.0:
            return replace(self, aspect=None)
        if self.orthographic_height is not None:
            return replace(self, aspect=None, orthographic_height=self.orthographic_height * factor)
        tangent = math.tan(0.5 * self.vertical_fov) * factor
        return replace(self, aspect=None, vertical_fov=2.0 * math.atan(tangent))

    def axes(self) -> NDArray[np.float64]:
        """Return the camera's axes in the world, 3x3: the columns are right, up and backward (+x, +y, +z)."""
        return matrix_from_quaternion(self.rotation)

    def world_from_camera(self) -> NDArray[np.float64]:
        """Return the 4x4 transform from OpenCV camera coordinates (x right, y down, z forward) to the world, m."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.axes() * (1.0, -1.0, -1.0)
        matrix[:3, 3] = self.position
        return matrix

    def intrinsics(self, width: int, height: int) -> NDArray[np.float64]:
        """Return OpenCV's matrix K, 3x3, px: pixel centers are at integers, so cx = (width - 1) / 2 without an offset.

        The matrix of an orthographic camera maps (x, y, 1) to pixels, for any z.
        """
        focal = self.framed(width / height).pixels(height)
        right, up = self.aperture_offset
        cx, cy = 0.5 * (width - 1) - focal * right, 0.5 * (height - 1) + focal * up
        return np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])

    def image_from_camera(self) -> NDArray[np.float64]:
        """Return the 4x4 matrix from OpenCV camera coordinates to those whose z axis passes through the image's center.

        It keeps z. A perspective camera's is a shear, an orthographic camera's a translation.
        """
        matrix = np.eye(4)
        right, up = self.aperture_offset
        matrix[:2, 2 if self.orthographic_height is None else 3] = -right, up
        return matrix

    def image_center(self, depth: Any) -> tuple[Any, Any]:
        """Return how far right and up of the optical axis the image's center is, m, at depths along the axis, m."""
        right, up = self.aperture_offset
        factor = depth if self.orthographic_height is None else 1.0
        return right * factor, up * factor

    def pixels(self, height: int) -> float:
        """Return the focal length in an image of that height, px; of an orthographic camera, px per meter."""
        if self.orthographic_height is not None:
            return height / self.orthographic_height
        return 0.5 * height / math.tan(0.5 * self.vertical_fov)

    def half_height(self, depth: float) -> float:
        """Return half the height of the visible region, m, at a depth in m along the axis."""
        return (
            depth * math.tan(0.5 * self.vertical_fov)
            if self.orthographic_height is None
            else 0.5 * self.orthographic_height
        )

    def frustum_planes(self, aspect: float, far: float | None = None) -> NDArray[np.float64]:
        """Return the six planes of the view frustum, [6, 4]: (n, d) with n·x + d >= 0 inside.

        Args:
            aspect: Width / height.
            far: Distance of the far plane, m. None: the camera's.

        Returns:
            Left, right, bottom, top, near, far.
        """
        right, up, backward = self.axes().T
        position, framed = np.asarray(self.position), self.framed(aspect)
        tangent, half = math.tan(0.5 * framed.vertical_fov), 0.0
        if framed.orthographic_height is not None:
            tangent, half = 0.0, 0.5 * framed.orthographic_height
        planes = []
        x, y = self.aperture_offset
        for across, size, offset in ((right, aspect, x), (-right, aspect, -x), (up, 1.0, y), (-up, 1.0, -y)):
            sheared, moved = (offset, 0.0) if framed.orthographic_height is None else (0.0, offset)
            normal = across - backward * (tangent * size - sheared)
            unit = normal / np.linalg.norm(normal)
            planes.append([*unit, half * size - moved - unit @ position])
        planes.append([*-backward, backward @ position - self.near])
        planes.append([*backward, -(backward @ position) + (self.far if far is None else far)])
        return np.array(planes)


def _are_numbers(values: Any, count: int) -> bool:
    """Return whether `values` are `count` finite numbers."""
    if not is_series(values):
        return False
    listed = list(values)
    if len(listed) != count or not all(map(is_number, listed)):
        return False
    try:
        return all(math.isfinite(value) for value in listed)
    except OverflowError:  # an integer too large for a float
        return False


def quaternion_from_matrix(matrix: NDArray[np.float64]) -> Quaternion:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a 3x3 rotation, from its largest component."""
    w, x, y, z = quaternions(np.asarray(matrix, dtype=np.float64)[None])[0].tolist()
    return (w, x, y, z)

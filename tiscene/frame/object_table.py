# SPDX-License-Identifier: Apache-2.0
"""Per-object annotations of a frame: identity, pose, boxes, visibility.

Boxes in the image are float (x0, y0, x1, y1), half-open: pixel column i spans i .. i + 1. So a box of whole numbers
slices an array, ``depth[y0:y1, x0:x1]``, and is COCO's (x0, y0, x1 - x0, y1 - y0); the origin is that of
`FrameCamera.K_at(0.5)`. A column is computed when it is first read, for all rows at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from operator import attrgetter
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.errors import ObjectNotFound, counted
from tiscene.frame.measurements import NO_MEASUREMENTS, ObjectMeasurements, OrientedBox
from tiscene.scene.camera import Quaternion, Vector3

Box = tuple[float, float, float, float]
SHOWN_NAMES = 10  # in the representation of a table


@dataclass(frozen=True)
class _LiveObject:
    id: int
    name: str
    template: str
    category: str
    category_id: int
    prim_path: str
    position: Vector3
    rotation: Quaternion
    velocity: Vector3
    first_frame: int
    last_frame: int | None
    blocked: bool = False
    parts: tuple[str, ...] = ()
    asset: str = ""
    room: str = ""


@dataclass(frozen=True, kw_only=True)
class ObjectState(_LiveObject):
    """A live object at one frame, as a world gives it; attributes as of `ObjectRow`, and one more.

    Attributes:
        box: lowest and highest corner around the object in its own axes, m, of which scale is a part.
    """

    box: tuple[Vector3, Vector3]


@dataclass(frozen=True, kw_only=True)
class ObjectRow(_LiveObject):
    """One live object at one frame.

    Attributes:
        id: value in the `instance` buffer.
        name: id in the scenario, or the prim's name.
        template: template that it was made from; "" for objects of the stage.
        category: semantic label; "" for none.
        category_id: value in the `semantic` buffer; 0 for none.
        prim_path: on the stage; "" for objects of the scenario.
        position: origin of the object's axes, world, m.
        rotation: unit quaternion (w, x, y, z).
        velocity: of the origin, from this frame to the next along its trajectory, m/s.
        first_frame: first frame of its lifespan.
        last_frame: last frame of its lifespan; None: no end.
        blocked: whether an obstacle has kept it from its trajectory since the frame before.
        parts: names of the values 1, 2, ... in the `part` buffer; () for an object of one part.
        asset: what it is a copy of: USD's assetInfo, the file referred to, or its template; "" if unknown.
        room: name of the room that its middle is in; "" for none.
    """

    _measures: ObjectMeasurements = field(repr=False, compare=False)
    _row: int = field(repr=False, compare=False)

    @property
    def world_from_object(self) -> NDArray[np.float64]:
        """The pose as a rigid 4x4 matrix."""
        matrix = np.eye(4)
        matrix[:3, :3] = matrix_from_quaternion(self.rotation)
        matrix[:3, 3] = self.position
        return matrix

    @property
    def visible_box(self) -> Box | None:
        """Tight box around its visible pixels; None if there are none."""
        return _box(self._measures.visible_box[self._row])

    @property
    def amodal_box(self) -> Box | None:
        """Box around the projection of all its geometry, including what is hidden or beyond the image's edges.

        An object that reaches behind the camera is clipped at its near plane, or at a tenth of the object's depth in
        front of the camera if that is less. None if nothing is in front of the camera.
        """
        return _box(self._measures.amodal_box[self._row])

    @property
    def box_3d(self) -> OrientedBox:
        """Bounding box in its own axes."""
        return self._measures.box_3d[self._row]

    @property
    def world_bounds(self) -> NDArray[np.float64]:
        """Axis-aligned bounds in the world: float64 [2, 3], lowest and highest corner, m."""
        bounds: NDArray[np.float64] = self._measures.world_bounds[self._row].copy()
        return bounds

    @property
    def visible_pixels(self) -> int:
        """Number of its pixels in the `instance` buffer."""
        return int(self._measures.visible_pixels[self._row])

    @property
    def amodal_pixels(self) -> int:
        """Number of pixels that it would cover without occluders, on an image without edges.

        Beyond the image's edges a large object is sampled at every s-th pixel along both axes, at most 16,384 samples.
        """
        return int(self._measures.amodal_pixels[self._row])

    @property
    def amodal_mask(self) -> NDArray[np.bool_]:
        """Pixels of the image that it would cover without occluders: bool [height, width].

        Its visible pixels are `frame.instance == id`.
        """
        return self._measures.amodal_mask(self._row)

    @property
    def fraction_in_frame(self) -> float:
        """Fraction of its amodal pixels that lies in the image, 0..1."""
        return _ratio(self._measures.pixels_in_frame[self._row], self._measures.amodal_pixels[self._row])

    @property
    def visibility_in_frame(self) -> float:
        """Fraction of its amodal pixels in the image that is not occluded, 0..1."""
        return _ratio(self._measures.visible_pixels[self._row], self._measures.pixels_in_frame[self._row])

    @property
    def fraction_visible(self) -> float:
        """Fraction of the object that is visible, 0..1: fraction_in_frame * visibility_in_frame."""
        return self.fraction_in_frame * self.visibility_in_frame


_values_of = attrgetter(*(each.name for each in fields(_LiveObject)))


class ObjectTable(Sequence[ObjectRow]):
    """The live objects of a frame, by ascending id.

    Args:
        states: the objects.
        measures: measurements of the same objects; needed unless there are none.
    """

    def __init__(self, states: Sequence[ObjectState] = (), measures: ObjectMeasurements | None = None) -> None:
        self._states = states
        self._measures: ObjectMeasurements = measures or NO_MEASUREMENTS

    @cached_property
    def _rows(self) -> tuple[ObjectRow, ...]:
        return tuple(
            ObjectRow(*_values_of(state), _measures=self._measures, _row=row) for row, state in enumerate(self._states)
        )

    def __len__(self) -> int:
        return len(self._states)

    def __iter__(self) -> Iterator[ObjectRow]:
        return iter(self._rows)

    @overload
    def __getitem__(self, index: int) -> ObjectRow: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[ObjectRow, ...]: ...

    def __getitem__(self, index: int | slice) -> ObjectRow | tuple[ObjectRow, ...]:
        return self._rows[index]

    def __repr__(self) -> str:
        names = [row.name for row in self._rows[:SHOWN_NAMES]] + ["..."] * (len(self) > SHOWN_NAMES)
        return f"<{counted(len(self), 'object')}: {', '.join(names)}>"

    def by_id(self, id: int) -> ObjectRow:
        """Return the object with an instance id.

        Raises:
            ObjectNotFound: no live object has it.
        """
        for row in self._rows:
            if row.id == id:
                return row
        known = [f"{row.name} ({row.id})" for row in self._rows]
        hint = "Ids are the values of the buffer `instance`, where 0 is the background."
        raise ObjectNotFound("object", id, known, " in this frame", hint)

    def by_name(self, name: str) -> ObjectRow:
        """Return the object with a name.

        Raises:
            ObjectNotFound: no live object has it.
        """
        for row in self._rows:
            if row.name == name:
                return row
        raise ObjectNotFound("object", name, [row.name for row in self._rows], " in this frame")

    def fractions_visible(self, rows: Sequence[ObjectRow]) -> list[float]:
        """Return `fraction_visible` of some of the rows, without measuring the others."""
        counts = self._measures.amodal_counts([row._row for row in rows]).tolist()
        seen = zip(rows, counts, strict=True)
        return [_ratio(inside, amodal) * _ratio(row.visible_pixels, inside) for row, (inside, amodal) in seen]

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return all columns as 1-D arrays with one entry per row, as data frames take them.

        They are those of `arrays`; a column of vectors becomes one per component: `position_x`, `visible_box_x0`,
        `rotation_w`, `world_bounds_x0` (lowest corner) and so on.
        """
        result: dict[str, NDArray[Any]] = {}
        for name, array in self.arrays().items():
            if array.ndim == 1:
                result[name] = array
            else:
                for component, values in zip(_components(name, array.shape[1]), array.T, strict=True):
                    result[f"{name}_{component}"] = values.copy()
        return result

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all columns as arrays with one entry per row; vectors and boxes are [rows, components].

        Text columns are str. Where a row has None, a float column has nan and `last_frame` has -1.
        """
        states, measures = self._states, self._measures
        boxes = measures.box_3d
        visible, amodal, inside = measures.visible_pixels, measures.amodal_pixels, measures.pixels_in_frame
        in_frame, in_sight = _ratios(inside, amodal), _ratios(visible, inside)
        return {
            "id": np.array([state.id for state in states], np.int32),
            "name": np.array([state.name for state in states], np.str_),
            "template": np.array([state.template for state in states], np.str_),
            "category": np.array([state.category for state in states], np.str_),
            "category_id": np.array([state.category_id for state in states], np.int32),
            "prim_path": np.array([state.prim_path for state in states], np.str_),
            "asset": np.array([state.asset for state in states], np.str_),
            "room": np.array([state.room for state in states], np.str_),
            "position": _floats([state.position for state in states], 3),
            "rotation": _floats([state.rotation for state in states], 4),
            "velocity": _floats([state.velocity for state in states], 3),
            "first_frame": np.array([state.first_frame for state in states], np.int64),
            "last_frame": np.array(
                [-1 if state.last_frame is None else state.last_frame for state in states], np.int64
            ),
            "blocked": np.array([state.blocked for state in states], np.bool_),
            "visible_box": measures.visible_box.copy(),
            "amodal_box": measures.amodal_box.copy(),
            "box_3d_center": _floats([box.center for box in boxes], 3),
            "box_3d_size": _floats([box.size for box in boxes], 3),
            "box_3d_rotation": _floats([box.rotation for box in boxes], 4),
            "world_bounds": _floats(measures.world_bounds, 6),
            "visible_pixels": visible.copy(),
            "amodal_pixels": amodal.copy(),
            "fraction_in_frame": in_frame,
            "visibility_in_frame": in_sight,
            "fraction_visible": in_frame * in_sight,
        }


def _floats(values: Any, columns: int) -> NDArray[np.float64]:
    return np.array(values, np.float64).reshape(len(values), columns)


def _components(name: str, count: int) -> tuple[str, ...]:
    """Return the names of the components of a column of vectors."""
    if name.endswith("rotation"):
        return "w", "x", "y", "z"
    corners = ("x0", "y0", "x1", "y1"), ("x0", "y0", "z0", "x1", "y1", "z1")
    return next((each for each in corners if len(each) == count), ("x", "y", "z"))


def _ratios(parts: NDArray[np.int64], wholes: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.where(wholes > 0, parts / np.maximum(wholes, 1), 0.0)


def _box(corners: NDArray[np.float64]) -> Box | None:
    if np.isnan(corners).any():
        return None
    x0, y0, x1, y1 = corners.tolist()
    return x0, y0, x1, y1


def _ratio(part: int, whole: int) -> float:
    return float(part / whole) if whole else 0.0

# SPDX-License-Identifier: Apache-2.0
"""A stream for tests of exporters and commands: renders nothing; has every buffer, different in every frame."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tiscene.errors import BufferNotFound, MissingExtra
from tiscene.export.formats import FORMATS
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.frame import Frame, FrameCamera
from tiscene.frame.measurements import OrientedBox
from tiscene.frame.object_table import ObjectState, ObjectTable
from tiscene.scene.camera import Camera

FRAMES = 4  # that `exported` writes
CHAIR = ObjectState(
    id=3,
    name="chair",
    template="Chair 01",
    category="chair",
    category_id=1,
    prim_path="",
    position=(1.0, 0.5, 0.0),
    rotation=(1.0, 0.0, 0.0, 0.0),
    velocity=(0.0, 0.0, 0.25),
    box=((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)),
    first_frame=0,
    last_frame=None,
    parts=("Seat", "Back"),
    asset="Chair 01",
)


class ChairMeasurements:
    """Measurements of the chair: half of its pixels are visible, and it has no amodal box."""

    visible_pixels = np.array([5])
    pixels_in_frame = np.array([8])
    amodal_pixels = np.array([10])
    visible_box = np.array([[1.0, 2.0, 4.0, 5.0]])
    amodal_box = np.full((1, 4), np.nan)
    world_bounds = np.array([[[0.5, 0.0, -0.5], [1.5, 1.0, 0.5]]])
    box_3d = (OrientedBox((1.0, 0.5, 0.0), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0, 0.0)),)

    def amodal_counts(self, rows):
        return np.array([[8, 10]] * len(rows))


def fake_buffer(name: str, index: int, width: int, height: int) -> np.ndarray:
    """Return values in the range of the buffer that depend on name and index; the first row is background."""
    buffer = BUFFERS[name]
    random = np.random.default_rng([index, *name.encode()])
    unit = random.random(buffer.shape(width, height))
    if buffer.dtype == "bool":
        values = unit > 0.5
    elif buffer.dtype == "uint8":
        values = unit * 256
    elif name in ("semantic", "instance", "part"):
        values = unit * 6
    elif name.endswith("coverage"):
        values = unit * (6.0, 1.0 / 6.0)
    elif "flow" in name or "normal" in name:
        values = 2.0 * unit - 1.0
    elif name in ("depth", "distance"):
        values = 0.5 + 5.0 * unit
    else:
        values = unit
    array = values.astype(buffer.dtype)
    if buffer.background is not None:
        array[0] = buffer.background
    return array


class FakeStream:
    """The part of Stream that `tiscene.export` and the commands use.

    Attributes:
        rendered: The indices of the frames that were requested.
        interrupt_at: The index at which a KeyboardInterrupt is raised; None for never.
        camera: The camera.
    """

    def __init__(self, buffers: Sequence[str] = tuple(BUFFERS), *, width=12, height=8, frames=None, seed=0) -> None:
        for name in buffers:
            if name not in BUFFERS:
                raise BufferNotFound("buffer", name, BUFFERS)
        self.buffers = tuple(buffers)
        self.width, self.height, self.fps, self.frames, self.seed = width, height, 25.0, frames, seed
        self.categories = {0: "", 1: "chair", 2: "table"}
        self.materials = {0: "", 1: "/Looks/Oak"}
        self.scenario = SimpleNamespace(to_json=lambda: {"scene": "nowhere", "objects": []})
        self.rendered: list[int] = []
        self.interrupt_at: int | None = None
        self.camera = Camera()

    def settings(self) -> dict[str, Any]:
        return {"width": self.width, "height": self.height, "fps": self.fps, "seed": self.seed}

    def file_digests(self) -> dict[str, str]:
        return {"scene.usda": "12ab"}

    def __getitem__(self, index: int) -> Frame:
        if index == self.interrupt_at:
            raise KeyboardInterrupt
        self.rendered.append(index)
        buffers = {name: fake_buffer(name, index, self.width, self.height) for name in self.buffers}
        camera = FrameCamera(self.camera, self.width, self.height)
        table = ObjectTable([CHAIR], ChairMeasurements())
        return Frame(index, index / self.fps, camera, buffers, table, self.categories, materials=self.materials)


# Formats that need no more of a stream than a FakeStream has.
FAKE_FORMATS = tuple(name for name in FORMATS if name != "tracks")
# Buffers of the formats whose list of buffers does not tell all that they can hold.
_BUFFERS = {
    "video": ("rgb", "semantic", "instance", "part", "depth", "distance", "forward_flow", "forward_occlusion"),
    "cryptomatte": ("rgb", "coverage", "material_coverage"),
}


def fake_stream_for(format: str, **arguments: Any) -> FakeStream:
    """Return a stream with all buffers that a format can hold."""
    form = FORMATS[format]
    listed = tuple(BUFFERS) if form.optional is None else (*form.buffers, *form.optional)
    return FakeStream(_BUFFERS.get(format, listed), **arguments)


def skip_without_extra(format: str) -> None:
    """Skip a test if the libraries of a format are not installed."""
    try:
        FORMATS[format].writer()
    except MissingExtra as error:
        pytest.skip(str(error))

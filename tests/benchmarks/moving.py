# SPDX-License-Identifier: Apache-2.0
"""Cameras that turn and walk through rooms with three movers: error, time and flicker of every preset.

`room_01` to `room_03` with three sampled movers. A camera turns by one degree a frame, walks 3 cm a frame, or does
both; "rests" is the same room with the camera at rest. Frames have SAILenv's five views and `denoised`.

PSNR: of `denoised`, times 2, clipped and encoded as sRGB, at the frames COMPARED, against path tracing at depth 8.
Two references with independent noise are used, because the mean product of the errors against both does not depend on
their noise. Displayed noise is darker than the displayed mean, which would count as an error of the picture: so each
reference has two parts, from which a jackknife removes that (Quenouille, Notes on bias in estimation, 1956). The parts
are kept in the cache folder. "once": the first frame. "frame" and "CPU": medians of wall and CPU time, "mean": of wall
time, with what new anchors cost; "again": median of wall time where the same views were rendered before. "flicker":
mean difference, in 8-bit levels, between `rgb` and the same points of static surfaces in the next frame, found by
`forward_flow`.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

import tiscene as ts
from dynamics.rotation import multiply
from tests.benchmarks.reference_pictures import note
from tests.benchmarks.timing import timed
from tiscene.files import cache_folder
from tiscene.render.view import View

ROOMS = ("room_01", "room_02", "room_03")
CAMERAS = ("rests", "turns", "walks", "both")
PRESETS = ("fast", "preview", "standard")
BUFFERS = ("rgb", "semantic", "instance", "forward_flow", "depth", "denoised")
SIZE = 256, 192
FRAMES, COMPARED = 24, (10, 20)  # COMPARED: frame indices
TURN, STEP = math.radians(1.0), 0.03  # a frame, rad and m
REFERENCE_SPP, REFERENCE_DEPTH = 64, 8  # of each part of a reference

Image = NDArray[np.float32]
Displayed = NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
    """A room with movers, seen by a camera.

    Attributes:
        room: scene name.
        camera: one of CAMERAS.
        size: image width and height, px.
    """

    room: str
    camera: str
    size: tuple[int, int] = SIZE

    def scenario(self) -> ts.Scenario:
        """Return the room with three movers in view of its main camera."""
        return ts.Scenario.sample(self.room, seed=7, objects=(3, 3), depth=(1.5, 4.0))

    def render(self, stream: ts.Stream, index: int) -> ts.Frame:
        """Render a frame of a stream of `scenario`."""
        start = stream.world.camera
        cameras = (_moved(start, self.camera, index + step) for step in (-1, 0, 1))
        return stream.render_view(index, View(*cameras, *self.size), stream.buffers)

    def stream(self, **settings: object) -> ts.Stream:
        """Return a stream of `scenario`."""
        width, height = self.size
        return ts.Stream(_scenario(self.room), width=width, height=height, **settings)


@functools.cache
def _scenario(room: str) -> ts.Scenario:
    return Shot(room, CAMERAS[0]).scenario()


def _moved(camera: ts.Camera, kind: str, index: int) -> ts.Camera:
    w, x, y, z = camera.rotation
    position = np.array(camera.position)
    if kind in ("turns", "both"):
        half = 0.5 * TURN * index
        w, x, y, z = multiply(np.array([math.cos(half), 0.0, math.sin(half), 0.0]), np.array(camera.rotation)).tolist()
    if kind in ("walks", "both"):
        ahead = -camera.axes()[:, 2] * (1.0, 0.0, 1.0)
        position = position + STEP * index * ahead / np.linalg.norm(ahead)
    return camera.with_pose(tuple(position.tolist()), (w, x, y, z))


def main(large: bool = False) -> None:
    """Print one line for each room, camera and preset, at 256x192 or, if large, at 640x480."""
    heads = ("PSNR", "once", "frame", "CPU", "mean", "frames/s", "again", "flicker")
    print(f"{'':<8} {'camera':<6} {'':<9}" + " {:>8} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8}".format(*heads))
    for room in ROOMS:
        for camera in CAMERAS:
            shot = Shot(room, camera, (640, 480) if large else SIZE)
            note(f"{room}, camera {camera}: references")
            truth = references(shot)
            for preset in PRESETS:
                line(shot, preset, truth)


def line(shot: Shot, preset: str, truth: dict[int, tuple[Displayed, Displayed]]) -> None:
    """Measure and print one preset."""
    with shot.stream(quality=preset, buffers=BUFFERS) as stream:
        once, _, _ = timed(shot.render, stream, 0)
        walls, cpus = [], []
        frames: dict[int, ts.Frame] = {}
        for index in range(1, FRAMES):
            wall, cpu, frame = timed(shot.render, stream, index)
            walls.append(wall)
            cpus.append(cpu)
            if index in COMPARED or index - 1 in COMPARED:
                frames[index] = frame
        again = [timed(shot.render, stream, index)[0] for index in reversed(range(FRAMES // 2, FRAMES))]
    errors = [product_of_errors(display(frames[k].denoised), *truth[k]) for k in COMPARED]
    wall, cpu, mean = 1e3 * np.median(walls), 1e3 * np.median(cpus), 1e3 * np.mean(walls)
    flicker = np.mean([difference(frames[k], frames[k + 1]) for k in COMPARED])
    print(
        f"{shot.room:<8} {shot.camera:<6} {preset:<9} {-10.0 * np.log10(np.mean(errors)):>5.1f} dB {once:>6.1f} s"
        f" {wall:>6.1f} ms {cpu:>6.1f} ms {mean:>6.1f} ms {1e3 / wall:>9.1f} {1e3 * np.median(again):>6.1f} ms"
        f" {flicker:>8.2f}",
        flush=True,
    )


def references(shot: Shot) -> dict[int, tuple[Displayed, Displayed]]:
    """Return two estimates of the displayed path-traced image, with independent noise, per compared frame."""
    parts: dict[int, list[Image]] = {}
    for part in range(4):
        stream = functools.cache(lambda part=part: shot.stream(
            quality="standard", spp=REFERENCE_SPP, max_depth=REFERENCE_DEPTH, seed=1000 + part, denoise=False,
            incremental=False, buffers=("hdr",),
        ))  # fmt: skip
        for index in COMPARED:
            parts.setdefault(index, []).append(_kept(shot, part, index, stream))
    return {index: (_displayed(*images[:2]), _displayed(*images[2:])) for index, images in parts.items()}


def _displayed(one: Image, other: Image) -> Displayed:
    """Return what `display` makes of the mean of noisy images, less its bias as the two of them tell: a jackknife."""
    return 2.0 * display(0.5 * (one + other)) - 0.5 * (display(one) + display(other))


def _kept(shot: Shot, part: int, index: int, stream: Callable[[], ts.Stream]) -> Image:
    """Return a reference image from the cache folder, or render and keep it."""
    identity = f"{shot} {_scenario(shot.room).to_json()} {part} {index} {REFERENCE_SPP} {REFERENCE_DEPTH}"
    folder = cache_folder() / "benchmark-references"
    file = folder / f"{hashlib.sha256(identity.encode()).hexdigest()[:24]}.npy"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        image = shot.render(stream(), index).hdr
        unfinished = file.with_suffix(".part.npy")
        np.save(unfinished, image)
        unfinished.replace(file)
    image: Image = np.load(file)
    return image


def display(radiance: Image) -> Displayed:
    """Return radiance times 2, clipped and encoded as sRGB, 0..1."""
    x = np.clip(2.0 * radiance.astype(np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


def product_of_errors(shown: Displayed, one: Displayed, other: Displayed) -> float:
    """Return the mean product of an image's errors against two references: its mean squared error without theirs."""
    return max(float(np.mean((shown - one) * (shown - other))), 1e-9)


def difference(frame: ts.Frame, after: ts.Frame) -> float:
    """Return the mean difference between `rgb` and that of the next frame at the same points of static surfaces."""
    height, width = frame.instance.shape
    y, x = np.mgrid[:height, :width] + np.moveaxis(frame.forward_flow[..., ::-1].astype(float), -1, 0)
    moving = [row.id for row in frame.objects if np.any(row.velocity)]
    # Edges are left out: there a pixel shows several surfaces.
    edges = np.zeros((height, width), bool)
    for axis in (0, 1):
        for step in (-1, 1):
            edges |= frame.instance != np.roll(frame.instance, step, axis)
    stays = (x > 1) & (x < width - 2) & (y > 1) & (y < height - 2) & (frame.instance > 0) & ~edges
    stays &= ~np.isin(frame.instance, moving)
    warped = np.stack([map_coordinates(after.rgb[..., c].astype(float), (y, x), order=1) for c in range(3)], axis=-1)
    return float(np.abs(warped - frame.rgb)[stays].mean())


if __name__ == "__main__":
    main()

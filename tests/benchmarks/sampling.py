# SPDX-License-Identifier: Apache-2.0
"""What scrambled Sobol points are worth: within pixels against independent ones, and across them against white noise.

Independent: as many pictures of one path a pixel, which know nothing of each other. relMSE: variance over pictures of
different seeds, over the squared mean plus 0.01; of all pixels, and without the noisiest twentieth, whose rare bright
paths decide the mean of all.

White: pictures whose every pixel, light, albedo and normal, is that of a seed of its own: the same noise in each, but
what it has to do with its neighbors' is gone. Both behind a Gaussian (of the relative error, 1.5 px), and behind OIDN
against a converged picture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tiscene.render.film.denoise import denoise
from tiscene.render.film.tone_map import LUMINANCE
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.stream.stream import Stream

ROOMS = ("room_01", "room_02", "room_03")
SIZE = (48, 36)
SAMPLES = (4, 8, 16, 32, 64)
TOTAL = 2048  # paths through each pixel, for each number of samples
DEPTH = 6
WIDE = (96, 72)  # of pictures whose pixels are looked at together
FEW = (1, 2, 4, 8, 16)
PICTURES = 16
CONVERGED = 1024
BLUR = 1.5  # px


class Room:
    """A room as its own camera sees it."""

    def __init__(self, name: str) -> None:
        stream = Stream(name, buffers=("depth",))
        self.scene = DeviceScene()
        for description in stream.world.descriptions:
            self.scene.add(description)
        self.scene.place(stream.world.placement(0))
        self._cameras = stream.world.view(0)

    def pictures(self, size: tuple[int, int], spp: int, count: int, first_seed: int = 0) -> list[PathImage]:
        """So many, of different seeds."""
        paths, view = PathPass(self.scene, *size), View(*self._cameras, *size)
        return [paths.render(view, frame_index=0, seed=first_seed + k, spp=spp, max_depth=DEPTH) for k in range(count)]


def luminance(images: list[PathImage]) -> NDArray[np.float64]:
    """[n, h, w]."""
    return np.array([image.hdr @ np.array(LUMINANCE) for image in images])


def relative(images: NDArray[np.float64], mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """relMSE of every pixel, [h, w]."""
    return np.asarray(images.var(axis=0, ddof=1) / (mean**2 + 0.01))


def steady(errors: NDArray[np.float64]) -> float:
    """Their mean without the largest twentieth."""
    return float(errors[errors < np.quantile(errors, 0.95)].mean())


def within_pixels(name: str, room: Room) -> None:
    single = luminance(room.pictures(SIZE, 1, TOTAL))
    mean = single.mean(axis=0)
    for spp in SAMPLES:
        apart = relative(single.reshape(-1, spp, *single.shape[1:]).mean(axis=1), mean)
        together = relative(luminance(room.pictures(SIZE, spp, TOTAL // spp)), mean)
        cells = f"{name:>10} {spp:>4}"
        for error in (np.mean, steady):
            a, b = error(apart), error(together)
            cells += f" {a:12.4f} {b:8.4f} {a / b:6.2f}"
        print(cells, flush=True)


def across_pixels(name: str, room: Room) -> None:
    exact = np.mean([image.hdr for image in room.pictures(WIDE, CONVERGED // 4, 4, 1 << 20)], axis=0)
    scale = exact @ np.array(LUMINANCE)
    random = np.random.default_rng(1)
    for spp in FEW:
        images = room.pictures(WIDE, spp, PICTURES)
        seeds = random.permuted(np.tile(np.arange(PICTURES)[:, None, None], (1, *scale.shape)), axis=0)
        y, x = np.mgrid[: scale.shape[0], : scale.shape[1]]
        layers = {part: np.array([getattr(image, part) for image in images]) for part in ("hdr", "albedo", "normal")}
        blurred, clean = [], []
        for pick in (seeds, np.arange(PICTURES)[:, None, None]):
            hdr, albedo, normal = (layer[pick, y, x] for layer in layers.values())
            error = (hdr - exact) @ np.array(LUMINANCE) / np.sqrt(scale**2 + 0.01)
            blurred.append(steady((gaussian_filter(error, (0.0, BLUR, BLUR)) ** 2).mean(axis=0)))
            shown = np.array([denoise(*each, "balanced") for each in zip(hdr, albedo, normal, strict=True)])
            clean.append(steady((((shown - exact) @ np.array(LUMINANCE)) ** 2 / (scale**2 + 0.01)).mean(axis=0)))
        cells = "".join(f" {a:10.5f} {b:8.5f} {a / b:6.2f}" for a, b in (blurred, clean))
        print(f"{name:>10} {spp:>4}{cells}", flush=True)


def main() -> None:
    rooms = {name: Room(name) for name in ROOMS}
    heads = (f"{name:>12} {'Sobol':>8} {'gain':>6}" for name in ("independent", "steady px"))
    print(f"{'room':>10} {'spp':>4}", *heads)
    for name, room in rooms.items():
        within_pixels(name, room)
    heads = (f"{name:>10} {'blue':>8} {'gain':>6}" for name in ("white blur", "OIDN"))
    print(f"{'room':>10} {'spp':>4}", *heads)
    for name, room in rooms.items():
        across_pixels(name, room)

# SPDX-License-Identifier: Apache-2.0
"""Benefit of scrambled Sobol points: within pixels over independent samples, across pixels over white noise.

Independent: the mean of as many pictures of one sample per pixel with different seeds. relMSE: variance over pictures
of different seeds, over the squared mean plus 0.01. It is printed for all pixels, and without the noisiest 5 %, whose
rare bright paths dominate the mean.

White: pictures in which each pixel's light, albedo and normal are those of a random seed. The noise of a pixel is the
same, but uncorrelated with its neighbors. Both are compared after a Gaussian of 1.5 px (of the relative error), and
after OIDN, against a converged picture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tiscene.render.film.denoise import denoise
from tiscene.render.film.tone_map import LUMINANCE
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.stream.stream import Stream

ROOMS = ("room_01", "room_02", "room_03")
SIZE = (48, 36)
SAMPLES = (4, 8, 16, 32, 64)
TOTAL = 2048  # samples per pixel over all pictures, for each number of samples
DEPTH = 6
SCREEN_SIZE = (96, 72)  # for errors across pixels
SCREEN_SAMPLES = (1, 2, 4, 8, 16)
PICTURES = 16
CONVERGED = 1024
BLUR = 1.5  # px


class Room:
    """A shipped scene from its default camera."""

    def __init__(self, name: str) -> None:
        stream = Stream(name, buffers=("depth",))
        self.scene = DeviceScene()
        for description in stream.world.descriptions:
            self.scene.add(description)
        self.scene.place(stream.world.state(0).placement)
        self._cameras = stream.world.state(0).cameras[0]

    def pictures(self, size: tuple[int, int], spp: int, count: int, first_seed: int = 0) -> list[PathImage]:
        """Return `count` pictures of consecutive seeds."""
        paths, view = PathPass(self.scene, *size), View(*self._cameras, *size)
        return [paths.render(view, frame_index=0, seed=first_seed + k, spp=spp, max_depth=DEPTH) for k in range(count)]


def luminance(images: list[PathImage]) -> NDArray[np.float64]:
    """Return the luminance of pictures, float64 [n, h, w]."""
    return np.array([image.hdr @ np.array(LUMINANCE) for image in images])


def relative(images: NDArray[np.float64], mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relMSE of every pixel, float64 [h, w]."""
    return np.asarray(images.var(axis=0, ddof=1) / (mean**2 + 0.01))


def steady(errors: NDArray[np.float64]) -> float:
    """Return the mean without the largest 5 %."""
    return float(errors[errors < np.quantile(errors, 0.95)].mean())


def within_pixels(name: str, room: Room) -> None:
    """Print the relMSE of independent samples and of Sobol points."""
    single = luminance(room.pictures(SIZE, 1, TOTAL))
    mean = single.mean(axis=0)
    for spp in SAMPLES:
        independent = relative(single.reshape(-1, spp, *single.shape[1:]).mean(axis=1), mean)
        sobol = relative(luminance(room.pictures(SIZE, spp, TOTAL // spp)), mean)
        cells = f"{name:>10} {spp:>4}"
        for error in (np.mean, steady):
            a, b = error(independent), error(sobol)
            cells += f" {a:12.4f} {b:8.4f} {a / b:6.2f}"
        print(cells, flush=True)


def across_pixels(name: str, room: Room) -> None:
    """Print the squared error of white and of correlated noise, after a blur and after OIDN."""
    exact = np.mean([image.hdr for image in room.pictures(SCREEN_SIZE, CONVERGED // 4, 4, 1 << 20)], axis=0)
    scale = exact @ np.array(LUMINANCE)
    random = np.random.default_rng(1)
    for spp in SCREEN_SAMPLES:
        images = room.pictures(SCREEN_SIZE, spp, PICTURES)
        seeds = random.permuted(np.tile(np.arange(PICTURES)[:, None, None], (1, *scale.shape)), axis=0)
        y, x = np.mgrid[: scale.shape[0], : scale.shape[1]]
        layers = {part: np.array([getattr(image, part) for image in images]) for part in ("hdr", "albedo", "normal")}
        blurred, denoised = [], []
        for pick in (seeds, np.arange(PICTURES)[:, None, None]):
            hdr, albedo, normal = (layer[pick, y, x] for layer in layers.values())
            error = (hdr - exact) @ np.array(LUMINANCE) / np.sqrt(scale**2 + 0.01)
            blurred.append(steady((gaussian_filter(error, (0.0, BLUR, BLUR)) ** 2).mean(axis=0)))
            filtered = np.array([denoise(*each, "balanced") for each in zip(hdr, albedo, normal, strict=True)])
            denoised.append(steady((((filtered - exact) @ np.array(LUMINANCE)) ** 2 / (scale**2 + 0.01)).mean(axis=0)))
        cells = "".join(f" {a:10.5f} {b:8.5f} {a / b:6.2f}" for a, b in (blurred, denoised))
        print(f"{name:>10} {spp:>4}{cells}", flush=True)


def main() -> None:
    """Print both tables."""
    rooms = {name: Room(name) for name in ROOMS}
    heads = (f"{name:>12} {'Sobol':>8} {'gain':>6}" for name in ("independent", "steady px"))
    print(f"{'room':>10} {'spp':>4}", *heads)
    for name, room in rooms.items():
        within_pixels(name, room)
    heads = (f"{name:>10} {'blue':>8} {'gain':>6}" for name in ("white blur", "OIDN"))
    print(f"{'room':>10} {'spp':>4}", *heads)
    for name, room in rooms.items():
        across_pixels(name, room)

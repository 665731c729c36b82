"""What scrambled Sobol points are worth: the error of the rooms at equal samples against independent ones.

Independent: as many pictures of one path a pixel, which know nothing of each other. relMSE: variance over pictures of
different seeds, over the squared mean plus 0.01; of all pixels, and without the noisiest twentieth, whose rare bright
paths decide the mean of all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.render.film import LUMINANCE
from tiscene.render.integrators.path import PathPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.stream import Stream

ROOMS = ("room_01", "room_02", "room_03")
SIZE = (48, 36)
SAMPLES = (4, 8, 16, 32, 64)
TOTAL = 2048  # paths through each pixel, for each number of samples
DEPTH = 6


def pictures(paths: PathPass, view: View, spp: int) -> NDArray[np.float64]:
    """The luminance of independent pictures that have TOTAL paths together, [n, h, w]."""
    images = (
        paths.render(view, frame_index=0, seed=seed, spp=spp, max_depth=DEPTH).hdr for seed in range(TOTAL // spp)
    )
    return np.array([image @ np.array(LUMINANCE) for image in images])


def relative(images: NDArray[np.float64], mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """relMSE of every pixel, [h, w]."""
    return np.asarray(images.var(axis=0, ddof=1) / (mean**2 + 0.01))


def steady(errors: NDArray[np.float64]) -> float:
    """Their mean without the largest twentieth."""
    return float(errors[errors < np.quantile(errors, 0.95)].mean())


def main() -> None:
    heads = (f"{name:>12} {'Sobol':>8} {'gain':>6}" for name in ("independent", "steady px"))
    print(f"{'room':>10} {'spp':>4}", *heads)
    for name in ROOMS:
        stream = Stream(name, buffers=("depth",))
        placement = stream.world.placement(0)
        scene = DeviceScene()
        for description in stream.world.descriptions:
            scene.add(description)
        scene.place(placement)
        paths, view = PathPass(scene, *SIZE), View(*stream.world.view(0), *SIZE)
        single = pictures(paths, view, 1)
        mean = single.mean(axis=0)
        for spp in SAMPLES:
            apart = relative(single.reshape(-1, spp, *single.shape[1:]).mean(axis=1), mean)
            together = relative(pictures(paths, view, spp), mean)
            cells = f"{name:>10} {spp:>4}"
            for error in (np.mean, steady):
                a, b = error(apart), error(together)
                cells += f" {a:12.4f} {b:8.4f} {a / b:6.2f}"
            print(cells, flush=True)

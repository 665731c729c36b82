# SPDX-License-Identifier: Apache-2.0
"""Pictures of a stage by tiscene and by Mitsuba 3, and how far two sets of pictures are apart."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tests.reference import mitsuba_scene
from tests.render.path_scenes import device_scene
from tests.render.validation.stages import Stage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View

SIZE = 24
RUNS, SPP = 12, 64
SINGLES, GROUP = 2048, 64  # pictures of one path a pixel, and how many make one estimate of its variance
BLOCK = 4  # px, of the squares that variances are compared in
FALSE_ALARM = 0.01  # of a set of pictures that agree, by any of its pixels

Pictures = NDArray[np.float64]  # [n, h, w], brightness


@dataclass(frozen=True)
class Agreement:
    """How two sets of pictures differ.

    ratio: of the means of all. precision: its standard error. z: of the difference of the whole pictures, in standard
    errors, as if normally distributed; pixels: the same of every pixel [h, w].
    """

    ratio: float
    precision: float
    z: float
    pixels: Pictures

    @property
    def differing(self) -> int:
        """How many pixels differ by more than chance. Šidák: one false alarm in a hundred pictures."""
        chance = 1.0 - (1.0 - FALSE_ALARM) ** (1.0 / self.pixels.size)
        return int((self.pixels > stats.norm.isf(0.5 * chance)).sum())


def agreement(ours: Pictures, theirs: Pictures, margin: float = 0.0) -> Agreement:
    """Welch's tests of the means of independent pictures [n, h, w]; margin: what they may differ by, as a part."""
    wholes = ours.mean(axis=(1, 2)), theirs.mean(axis=(1, 2))
    errors = [whole.std(ddof=1) / np.sqrt(len(whole)) / whole.mean() for whole in wholes]
    return Agreement(
        float(wholes[0].mean() / wholes[1].mean()),
        float(np.hypot(*errors)),
        float(_z(*wholes, margin)),
        np.asarray(_z(ours, theirs, margin)),
    )


def _z(ours: Pictures, theirs: Pictures, margin: float) -> Pictures:
    variances = [each.var(axis=0, ddof=1) / len(each) for each in (ours, theirs)]
    gap = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) - margin * theirs.mean(axis=0)
    total = variances[0] + variances[1]
    parts = [variance**2 / (len(each) - 1) for variance, each in zip(variances, (ours, theirs), strict=True)]
    freedom = np.maximum(total**2 / np.maximum(parts[0] + parts[1], 1e-300), 1.0)
    t = np.maximum(gap, 0.0) / np.sqrt(np.maximum(total, (1e-4 * theirs.mean()) ** 2))
    return np.asarray(stats.norm.isf(np.maximum(stats.t.sf(t, freedom), 1e-300)))


def our_pictures(stage: Stage, runs: int = RUNS, spp: int = SPP, depth: int | None = None) -> Pictures:
    """With different seeds."""
    paths = PathPass(device_scene(stage.description), SIZE, SIZE)
    view = View(stage.camera, stage.camera, stage.camera, SIZE, SIZE)
    pictures = []
    for seed in range(runs):
        image = paths.render(view, frame_index=0, seed=seed, spp=spp, max_depth=depth or stage.depth)
        assert paths.nonfinite == 0
        pictures.append(image.hdr.mean(axis=2, dtype=np.float64))
    return np.array(pictures)


def mitsuba_pictures(stage: Stage, runs: int = RUNS, spp: int = 2 * SPP, depth: int | None = None) -> Pictures:
    """With different seeds, of twice the paths: it samples independently.

    The seeds lie far apart: pictures of neighboring ones are correlated there, by a hundredth.
    """
    mitsuba.set_variant("scalar_rgb")
    scene = mitsuba_scene.scene(
        mitsuba, stage.description, stage.camera, SIZE, SIZE, max_depth=depth or stage.depth, spp=spp
    )
    seeds = np.random.default_rng(1).integers(1 << 31, size=runs).tolist()
    pictures = [np.array(mitsuba.render(scene, spp=spp, seed=seed)).mean(axis=2) for seed in seeds]
    return np.array(pictures, np.float64)


def means(stage: Stage) -> Agreement:
    """Of the stage's pictures."""
    return agreement(our_pictures(stage), mitsuba_pictures(stage), stage.margin)


def variances(stage: Stage) -> Agreement:
    """Of what one path brings that ends at the first light, before roulette: in squares of BLOCK pixels."""
    ours, theirs = (make(stage, SINGLES, 1, 2) for make in (our_pictures, mitsuba_pictures))
    return agreement(_variances(ours), _variances(theirs), 2.0 * stage.margin)


def _variances(pictures: Pictures) -> Pictures:
    groups = pictures.reshape(-1, GROUP, *pictures.shape[1:]).var(axis=1, ddof=1)
    blocks = SIZE // BLOCK
    return np.asarray(groups.reshape(-1, blocks, BLOCK, blocks, BLOCK).mean(axis=(2, 4)))

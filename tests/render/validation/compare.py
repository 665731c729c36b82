# SPDX-License-Identifier: Apache-2.0
"""Images of a stage by tiscene and by Mitsuba 3, and statistical comparison of two sets of images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mitsuba
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tests.reference import mitsuba_scene
from tests.render.path_scenes import device_scene
from tests.render.validation.stages import Stage
from tiscene.device.memory import upload
from tiscene.render.bsdfs.energy_tables import GLASS_AT
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View

SIZE = 24
RUNS, SPP = 12, 64
SINGLES, GROUP = 2048, 64  # images at 1 spp, and how many of them give one estimate of the variance
BLOCK = 4  # px, side of the squares in which variances are compared
FALSE_ALARM = 0.01  # probability that any pixel of two equally distributed sets of images differs

Images = NDArray[np.float64]  # [n, h, w], brightness


@dataclass(frozen=True)
class Agreement:
    """Result of comparing two sets of images.

    Attributes:
        ratio: Ratio of the overall means.
        precision: Standard error of the ratio.
        z: Difference of the overall means, in standard errors of a normal distribution.
        pixels: The same for every pixel, [h, w].
    """

    ratio: float
    precision: float
    z: float
    pixels: Images

    @property
    def differing(self) -> int:
        """Number of pixels that differ significantly, with Šidák's correction."""
        chance = 1.0 - (1.0 - FALSE_ALARM) ** (1.0 / self.pixels.size)
        return int((self.pixels > stats.norm.isf(0.5 * chance)).sum())


def agreement(ours: Images, theirs: Images, margin: float = 0.0) -> Agreement:
    """Apply Welch's test to the means of independent images.

    Args:
        ours: Images [n, h, w].
        theirs: Images [m, h, w].
        margin: Relative difference to tolerate.
    """
    wholes = ours.mean(axis=(1, 2)), theirs.mean(axis=(1, 2))
    errors = [whole.std(ddof=1) / np.sqrt(len(whole)) / whole.mean() for whole in wholes]
    return Agreement(
        float(wholes[0].mean() / wholes[1].mean()),
        float(np.hypot(*errors)),
        float(_z(*wholes, margin)),
        np.asarray(_z(ours, theirs, margin)),
    )


def _z(ours: Images, theirs: Images, margin: float) -> Images:
    variances = [each.var(axis=0, ddof=1) / len(each) for each in (ours, theirs)]
    gap = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) - margin * theirs.mean(axis=0)
    total = variances[0] + variances[1]
    parts = [variance**2 / (len(each) - 1) for variance, each in zip(variances, (ours, theirs), strict=True)]
    freedom = np.maximum(total**2 / np.maximum(parts[0] + parts[1], 1e-300), 1.0)
    t = np.maximum(gap, 0.0) / np.sqrt(np.maximum(total, (1e-4 * theirs.mean()) ** 2))
    return np.asarray(stats.norm.isf(np.maximum(stats.t.sf(t, freedom), 1e-300)))


def tiscene_images(stage: Stage, runs: int = RUNS, spp: int = SPP, depth: int | None = None) -> Images:
    """Render images with different seeds."""
    paths = PathPass(device_scene(stage.description), SIZE, SIZE)
    scene = paths.scene_arrays()
    if not stage.compensates:
        scene = replace(scene, energy=_lossless(scene.energy))
    view = View(stage.camera, stage.camera, stage.camera, SIZE, SIZE)
    images = []
    for seed in range(runs):
        image = paths.render(view, frame_index=0, seed=seed, spp=spp, max_depth=depth or stage.depth, scene=scene)
        assert paths.nonfinite == 0
        images.append(image.hdr.mean(axis=2, dtype=np.float64))
    return np.array(images)


def _lossless(energy: Any) -> Any:
    """Return tables of albedos by which no light is lost, so that none is compensated."""
    tables = energy.to_numpy()
    tables[:GLASS_AT].reshape(-1, 2)[:] = 1.0, 0.0
    return upload(tables)


def mitsuba_images(stage: Stage, runs: int = RUNS, spp: int = 2 * SPP, depth: int | None = None) -> Images:
    """Render images with different seeds, at twice the samples, since Mitsuba samples independently.

    The seeds are far apart: images of consecutive seeds have a correlation of 0.01 in Mitsuba.
    """
    mitsuba.set_variant("scalar_rgb")
    scene = mitsuba_scene.scene(
        mitsuba, stage.description, stage.camera, SIZE, SIZE, max_depth=depth or stage.depth, spp=spp
    )
    seeds = np.random.default_rng(1).integers(1 << 31, size=runs).tolist()
    images = [np.array(mitsuba.render(scene, spp=spp, seed=seed)).mean(axis=2) for seed in seeds]
    return np.array(images, np.float64)


def means(stage: Stage) -> Agreement:
    """Compare the means of a stage's images."""
    return agreement(tiscene_images(stage), mitsuba_images(stage), stage.margin)


def variances(stage: Stage) -> Agreement:
    """Compare the variance of single paths of depth 2 (no Russian roulette), in squares of BLOCK pixels."""
    ours, theirs = (make(stage, SINGLES, 1, 2) for make in (tiscene_images, mitsuba_images))
    return agreement(_variances(ours), _variances(theirs), 2.0 * stage.margin)


def _variances(images: Images) -> Images:
    groups = images.reshape(-1, GROUP, *images.shape[1:]).var(axis=1, ddof=1)
    blocks = SIZE // BLOCK
    return np.asarray(groups.reshape(-1, blocks, BLOCK, blocks, BLOCK).mean(axis=(2, 4)))

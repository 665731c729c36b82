"""tiscene against Mitsuba 3 on every stage: the whole picture's mean, and every pixel's."""

import mitsuba
import numpy as np
import pytest
from scipy import stats

from tests.reference import mitsuba_scene
from tests.render.path_scenes import device_scene
from tests.render.validation.stages import FAST, STAGES, Stage
from tiscene.render.integrators.path import PathPass
from tiscene.render.view import View

SIZE = 24
RUNS, SPP = 12, 64


def our_runs(stage: Stage) -> np.ndarray:
    """[runs, h, w]: the brightness of pictures with different seeds."""
    paths = PathPass(device_scene(stage.description), SIZE, SIZE)
    view = View(stage.camera, stage.camera, stage.camera, SIZE, SIZE)
    runs = []
    for seed in range(RUNS):
        runs.append(paths.render(view, frame_index=0, seed=seed, spp=SPP, max_depth=stage.depth).hdr)
        assert paths.nonfinite == 0
    return np.array(runs, np.float64).mean(axis=3)


def mitsuba_runs(stage: Stage) -> np.ndarray:
    mitsuba.set_variant("scalar_rgb")
    scene = mitsuba_scene.scene(mitsuba, stage.description, stage.camera, SIZE, SIZE, max_depth=stage.depth, spp=SPP)
    # It samples independently: more samples make up for it.
    runs = [np.array(mitsuba.render(scene, spp=2 * SPP, seed=1000 + run)) for run in range(RUNS)]
    return np.array(runs, np.float64).mean(axis=3)


def difference(ours: np.ndarray, theirs: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """How far the means over the runs are apart beyond a margin, and the degrees of freedom of that (Welch), both in
    the shape of one run; in standard errors."""
    variances = ours.var(axis=0, ddof=1) / len(ours), theirs.var(axis=0, ddof=1) / len(theirs)
    gap = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) - margin * theirs.mean(axis=0)
    total = variances[0] + variances[1]
    freedom = np.maximum(total**2 / np.maximum(sum(v**2 / (RUNS - 1) for v in variances), 1e-300), 1.0)
    return np.maximum(gap, 0.0) / np.sqrt(np.maximum(total, (1e-4 * theirs.mean()) ** 2)), freedom


@pytest.mark.parametrize(
    "name", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in STAGES]
)
def test_means_agree(name: str) -> None:
    stage = STAGES[name]()
    ours, theirs = our_runs(stage), mitsuba_runs(stage)
    wholes = ours.mean(axis=(1, 2)), theirs.mean(axis=(1, 2))
    z, freedom = difference(wholes[0], wholes[1], stage.margin)
    assert np.hypot(wholes[0].std(), wholes[1].std()) / np.sqrt(RUNS) < 0.006 * theirs.mean()  # or z says nothing
    assert 2.0 * stats.t.sf(z, freedom) > 0.001, (wholes[0].mean(), wholes[1].mean())

    # Šidák: one false alarm in a hundred pictures.
    z, freedom = difference(ours, theirs, stage.margin)
    p = 2.0 * stats.t.sf(z, freedom)
    assert (p < 1.0 - (1.0 - 0.01) ** (1.0 / p.size)).sum() <= stage.edges, np.argwhere(p < 1e-5)

# SPDX-License-Identifier: Apache-2.0
"""tiscene against Mitsuba 3 on every stage: the mean and the variance, of the whole picture and of its parts."""

from collections.abc import Iterable

import numpy as np
import pytest

from tests.render.validation import motion
from tests.render.validation.compare import agreement, means, variances
from tests.render.validation.stages import FAST, STAGES


def slowly(names: Iterable[str]) -> list[object]:
    """The stages as parameters; but for a few they are for the slow suite."""
    return [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in names]


@pytest.mark.parametrize("name", slowly(STAGES))
def test_means_agree(name: str) -> None:
    stage = STAGES[name]()
    found = means(stage)
    assert found.precision < 0.006  # or z says nothing
    assert found.z < 3.3, found.ratio
    assert found.differing <= stage.edges, np.argwhere(found.pixels > 4.4)


@pytest.mark.parametrize("name", slowly(name for name in STAGES if STAGES[name]().noise != "other"))
def test_variances_agree(name: str) -> None:
    """Where both sample alike, one path's variance is the same; where we sample better, it is less."""
    stage = STAGES[name]()
    found = variances(stage)
    assert found.precision < 0.1  # most are at 0.01
    if stage.noise == "less":
        assert found.ratio < 1.0 + 2.0 * stage.margin + 3.3 * found.precision
    else:
        assert found.z < 3.3, found.ratio
        assert found.differing <= stage.edges // 4, found.pixels.round(1)  # such pixels are neighbors


@pytest.mark.slow
def test_what_moves_is_blurred_alike() -> None:
    found = motion.agreement_of_pictures()
    assert found.precision < 0.006
    assert found.z < 3.3, found.ratio
    assert found.differing <= 2, np.argwhere(found.pixels > 4.4)


def test_differences_are_found() -> None:
    """Noise of two sets that agree, and of some that do not."""
    random = np.random.default_rng(2)

    def pictures(mean: float = 1.0) -> np.ndarray:
        return random.gamma(4.0, mean / 4.0, (64, 12, 12))

    same = agreement(pictures(), pictures())
    assert same.z < 3.3
    assert same.differing == 0
    assert same.pixels.mean() == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.15)  # of half a normal distribution
    assert agreement(pictures(), pictures(1.05)).z > 3.3
    assert agreement(pictures(), pictures(1.05), margin=0.05).z < 3.3
    one = pictures()
    one[:, 3, 7] *= 2.0
    assert agreement(one, pictures()).differing == 1

# SPDX-License-Identifier: Apache-2.0
"""tiscene against Mitsuba 3 on every stage: mean and variance, of the whole image and of its pixels or blocks."""

import numpy as np
import pytest

from tests.render.validation import motion
from tests.render.validation.compare import agreement, means, variances
from tests.render.validation.stages import FAST, STAGES


@pytest.mark.parametrize(
    "name", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in STAGES]
)
def test_means_match_mitsuba(name: str) -> None:
    stage = STAGES[name]()
    found = means(stage)
    assert found.precision < 0.006  # otherwise z would be a weak test
    assert found.z < 3.3, found.ratio
    assert found.differing <= stage.edges, np.argwhere(found.pixels > 4.4)


COMPARABLE = [name for name in STAGES if STAGES[name]().noise != "other"]


@pytest.mark.slow
@pytest.mark.parametrize("name", COMPARABLE)
def test_variances_match_mitsuba_or_are_less(name: str) -> None:
    """The variance of a path is the same where both sample alike, and less where tiscene samples better."""
    stage = STAGES[name]()
    found = variances(stage)
    assert found.precision < 0.1  # most are at 0.01
    if stage.noise == "less":
        assert found.ratio < 1.0 + 2.0 * stage.margin + 3.3 * found.precision
    else:
        assert found.z < 3.3, found.ratio
        assert found.differing <= stage.edges // 4, found.pixels.round(1)  # such pixels are neighbors


@pytest.mark.slow
def test_motion_blur_matches_mitsuba() -> None:
    found = motion.motion_blur_agreement()
    assert found.precision < 0.006
    assert found.z < 3.3, found.ratio
    assert found.differing <= 2, np.argwhere(found.pixels > 4.4)


def test_agreement_detects_differences() -> None:
    """Sets of equal and of different distributions."""
    random = np.random.default_rng(2)

    def images(mean: float = 1.0) -> np.ndarray:
        return random.gamma(4.0, mean / 4.0, (64, 12, 12))

    same = agreement(images(), images())
    assert same.z < 3.3
    assert same.differing == 0
    assert same.pixels.mean() == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.15)  # half-normal distribution
    assert agreement(images(), images(1.05)).z > 3.3
    assert agreement(images(), images(1.05), margin=0.05).z < 3.3
    one = images()
    one[:, 3, 7] *= 2.0
    assert agreement(one, images()).differing == 1

# SPDX-License-Identifier: Apache-2.0
"""Draw scenarios until their measured difficulty lies within bands, for `Scenario.sample(difficulty=...)`.

Difficulty is measured on few small frames of labels. If only the motion misses its band, the speeds of all objects are
multiplied so that it fits. Otherwise the scenario is drawn again, of another seed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from tiscene.errors import ArgumentError, ScenarioError
from tiscene.frame.difficulty import MEASURES, Difficulty, summary
from tiscene.randomization.factors import factor_draws, with_factor
from tiscene.randomization.ranges import check_frames, range_of
from tiscene.scenario.scenario import Scenario
from tiscene.stream.progress import ProgressBar
from tiscene.stream.stream import Stream

ATTEMPTS = 16
FRAMES = 8
SECONDS = 10.0  # of an endless scenario that are measured
FPS = 25.0
WIDTH = 128  # px; `motion` is in pixels of this size
MOST = {"visibility": 1.0, "size": 1.0, "moving": 1.0, "contrast": 1.0, "novelty": 180.0}
SPEED_TRIES = 3


def sample_difficulty(
    draw: Callable[[int], Scenario], bands: Mapping[str, Any], *, seed: int, frames: int | None, aspect: float
) -> Scenario:
    """Return the first scenario within bands of difficulty.

    Args:
        draw: draws a scenario of a seed.
        bands: range of the mean of each measure, by its name in `Difficulty`.
        seed: of the first draw, from which the others' are derived.
        frames: length of the scenario, in frames at 25 per second; None: the first 10 s are measured.
        aspect: width / height of the image.

    Raises:
        ArgumentError: there is no such measure, or a band is wrong.
        ScenarioError: no draw lies within the bands.
    """
    limits = _checked(bands)
    reached: dict[str, list[float]] = {name: [] for name in limits}
    progress = ProgressBar()
    buffers = ("instance", "forward_flow", *(("rgb",) if "contrast" in limits else ()))
    end = round(SECONDS * FPS) if frames is None else check_frames(frames, "frames")
    indices = sorted({number * end // FRAMES for number in range(FRAMES)})
    stream: Stream | None = None
    try:
        for attempt in range(ATTEMPTS):
            progress("sampling to a difficulty", attempt / ATTEMPTS)
            scenario = draw(seed if attempt == 0 else _derived(seed, attempt))
            for _ in range(SPEED_TRIES):
                if stream is None:
                    height = max(1, round(WIDTH / aspect))
                    stream = Stream(
                        scenario,
                        width=WIDTH,
                        height=height,
                        fps=FPS,
                        buffers=buffers,
                        quality="fast",
                        incremental=False,
                    )
                else:
                    stream.restart(scenario)
                shown = (stream[index] for index in indices)
                if "novelty" not in limits:  # it costs more than the other measures
                    shown = (replace(frame, _novelty=None) for frame in shown)
                means = measured_means([frame.difficulty for frame in shown])
                missed = [name for name, (low, high) in limits.items() if not low <= means.get(name, -1.0) <= high]
                if not missed:
                    return scenario
                for name in missed:
                    if name in means:
                        reached[name].append(means[name])
                if missed != ["motion"] or means["motion"] == 0.0:
                    break
                low, high = limits["motion"]
                scenario = with_factor(scenario, "speed", 0.5 * (low + high) / means["motion"])
    finally:
        progress("sampling to a difficulty", 1.0)
        if stream is not None:
            stream.close()
    raise ScenarioError(f"difficulty: none of {ATTEMPTS} draws lies within the bands: {_tally(limits, reached)}")


def measured_means(measured: list[Difficulty]) -> dict[str, float]:
    """Return the mean of each measure that has values."""
    means = {name: values["mean"] for name, values in summary(measured).items()}
    return {name: mean for name, mean in means.items() if mean is not None}


def _checked(bands: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    if not isinstance(bands, Mapping) or not bands:
        raise ArgumentError(f"difficulty={bands!r}: must map measures to ranges, such as {{'motion': (1, 3)}}")
    for name in bands:
        if name not in MEASURES:
            raise ArgumentError(f"difficulty: no measure {name!r}; there are {', '.join(MEASURES)}")
    return {name: range_of(band, f"difficulty: {name}", MOST.get(name, 1e9)) for name, band in bands.items()}


def _derived(seed: int, attempt: int) -> int:
    """Return the seed of a later draw: any number below 2^53, so that files can hold it."""
    return int(factor_draws(seed, "difficulty").uniform("seed", attempt)[0] * 2**53)


def _tally(limits: Mapping[str, tuple[float, float]], reached: Mapping[str, list[float]]) -> str:
    parts = []
    for name, values in reached.items():
        if values:
            low, high = limits[name]
            span = f"{min(values):.3g} to {max(values):.3g}"
            parts.append(f"{name} was {span} in {len(values)} of them, not within {low:g}..{high:g}")
    return "; ".join(parts) + ". Widen the bands, or change the ranges that the scenarios are drawn from"

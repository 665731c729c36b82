# SPDX-License-Identifier: Apache-2.0
"""Print the table of docs/validation.md: `python -m tests.render.validation [STAGE ...]`. Asserts nothing."""

import sys

import numpy as np

from tests.render.validation import motion
from tests.render.validation.compare import Agreement, means, variances
from tests.render.validation.stages import STAGES

MOTION = "motion blur"


def row(name: str, mean: Agreement, variance: Agreement | None, less: bool = False) -> str:
    """Return a table row: ratio and largest z of means and variances.

    Args:
        name: Name of the stage.
        mean: Agreement of the means.
        variance: Agreement of the variances, if they are comparable.
        less: Whether our variance should be below Mitsuba's.
    """
    cells = [name]
    for found in (mean, variance):
        cells += [f"{found.ratio:.4f}", f"{found.z:.1f}", f"{np.max(found.pixels):.1f}"] if found else 3 * ["–"]
    if less:
        cells[-2:] = "less", "less"
    return f"| {' | '.join(cells)} |"


def main(names: list[str]) -> None:
    """Print the rows of the named stages; without names, of all."""
    print("| stage | mean | z | worst px | variance | z | worst block |", flush=True)
    for name in names or [*STAGES, MOTION]:
        if name == MOTION:
            print(row(name, motion.motion_blur_agreement(), None), flush=True)
            continue
        stage = STAGES[name]()
        variance = None if stage.noise == "other" else variances(stage)
        print(row(name, means(stage), variance, stage.noise == "less"), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

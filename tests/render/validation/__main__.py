# SPDX-License-Identifier: Apache-2.0
"""The table of docs/validation.md: `python -m tests.render.validation [STAGE ...]`. It asserts nothing."""

import sys

import numpy as np

from tests.render.validation import motion
from tests.render.validation.compare import Agreement, means, variances
from tests.render.validation.stages import STAGES

MOTION = "motion blur"


def row(name: str, mean: Agreement, variance: Agreement | None, less: bool = False) -> str:
    """Ratio and largest z of the means and of the variances. less: there ours should be below theirs."""
    cells = [name]
    for found in (mean, variance):
        cells += [f"{found.ratio:.4f}", f"{found.z:.1f}", f"{np.max(found.pixels):.1f}"] if found else 3 * ["–"]
    if less:
        cells[-2:] = "less", "less"
    return f"| {' | '.join(cells)} |"


def main(names: list[str]) -> None:
    print("| stage | mean | z | worst px | variance | z | worst block |", flush=True)
    for name in names or [*STAGES, MOTION]:
        if name == MOTION:
            print(row(name, motion.agreement_of_pictures(), None), flush=True)
            continue
        stage = STAGES[name]()
        variance = None if stage.noise == "other" else variances(stage)
        print(row(name, means(stage), variance, stage.noise == "less"), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

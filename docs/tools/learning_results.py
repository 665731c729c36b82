# SPDX-License-Identifier: Apache-2.0
"""Write docs/learning-results.md and its curves: the baselines on the suites.

    python -m docs.tools.learning_results                   # evaluate all learners on all suites, then write the page
    python -m docs.tools.learning_results --scores RESULTS  # of the scores in RESULTS/<suite>/*.json

Each suite in RESULTS gets a section. RESULTS/<suite> is what this has written:

    tiscene evaluate <suite> --learner all --seeds N -o RESULTS/<suite>
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from tiscene.cli.main import main as tiscene
from tiscene.learning.course import Course
from tiscene.learning.learner import BASELINES
from tiscene.learning.results_page import COLUMNS, marks_of, mean_and_range, percent, test_curve, value_of
from tiscene.learning.score import Score
from tiscene.learning.suite_names import suites
from tiscene.learning.svg_chart import line_chart, line_styles

DOCS = Path(__file__).parents[1]
SUITES = ("solids", "room", "home")
STYLE = (
    "<style>svg{background:#fff}text{font:11px sans-serif;fill:#444c56}polyline{fill:none;stroke-width:1.8}"
    ".grid{stroke:#e3e6e9}.mark{stroke:#8a939c;stroke-dasharray:3 3}</style>"
)
SHOWN = ("naive", "replay", "shuffled", "ewc", "blind", "ncm")  # in the curves
CURVES = (
    ("online", "Online accuracy"),
    ("near_future", "Near-future accuracy: 50 frames ahead"),
    ("test", "Mean class accuracy of the test of the first phase ({}) after each phase"),
)
NEWLINES = "\n\n"

INTRODUCTION = """# Results of the baselines

What the shipped learners reach on the suites, written by `python -m docs.tools.learning_results`. Percent, mean ±
standard deviation over seeds of the learners. All learners see the same frames and the same labels. `solids` has
primitives, two new ones in each phase, then the first ones again in fading light. `room` has a furnished room with two
moving objects of each category, then night, other chairs, and clutter. In `home` the camera walks from room to room, by
day and then at night, and all pixels of eleven categories count. Frames have 64 × 48 px. In each, one pixel of every
moving object is labeled, and two random pixels.

- online: accuracy on the pixels of objects, of each frame before it is learned. near future: the same, 50 frames ahead.
- ACC, BWT, forgetting, FWT and held out: mean class accuracies of tests on other paths; see
  [Evaluation](learning.md#evaluation).
- `shuffled` keeps all labels and trains anew after each phase: its ACC is an upper bound, its online accuracy means
  nothing.

`tiscene evaluate room --learner naive` takes 153 s and 2.6 GB of memory on two cores, in a fresh environment with an
empty cache of kernels. Rendering is nine tenths of it, and learners that are evaluated at once share it.

Networks come out differently with another version of PyTorch or on another processor. `solids` computed again with
PyTorch 2.15: `blind` and `ncm`, which are no networks, had every digit of the table; the ACC of `replay` was
93.7 ± 1.2, and that of `naive` 25.8 ± 5.6, within the deviations.
"""


def scores_of(folder: Path) -> dict[str, list[Score]]:
    """Return the scores in a folder by learner, in the order of BASELINES."""
    found: dict[str, list[Score]] = {}
    for path in sorted(folder.glob("*-seed*.json")):
        score = Score.load(path)
        found.setdefault(score.name, []).append(score)
    order = [*(name for name in BASELINES if name in found), *(name for name in found if name not in BASELINES)]
    return {name: found[name] for name in order}


def table(scores: Mapping[str, Sequence[Score]]) -> str:
    """Return the scores as a Markdown table."""
    lines = ["| Learner | " + " | ".join(name for name, _, _ in COLUMNS) + " | learning, s |"]
    lines.append("|---" + "|---:" * (len(COLUMNS) + 1) + "|")
    for name, runs in scores.items():
        values = [percent([value_of(run.scores, keys) for run in runs]) for _, _, keys in COLUMNS]
        seconds = runs[0].resources["cpu_seconds"].get("learn", 0.0)
        lines.append(f"| `{name}` | " + " | ".join(values) + f" | {seconds:.0f} |")
    return "\n".join(lines)


def chart(curves: Mapping[str, Sequence[Sequence[tuple[int, float]]]], course: Course, path: Path, label: str) -> None:
    """Write curves of several seeds by learner as an SVG file."""
    lines, bands = mean_and_range(curves)
    styles = line_styles(list(SHOWN))
    drawn = line_chart(lines, end=len(course), marks=marks_of(course), colors=styles, label=label, bands=bands)
    body = drawn.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1).replace(">", f">{STYLE}", 1)
    path.write_text(body + "\n", encoding="utf-8")


def legend() -> str:
    """Return the names of the colors of the learners."""
    names = {"#0072b2": "blue", "#d55e00": "orange-red", "#009e73": "green", "#cc79a7": "pink", "#e69f00": "orange"}
    names |= {"#56b4e9": "light blue"}
    return ", ".join(f"{name} {names[color]}" for name, (color, _) in line_styles(list(SHOWN)).items())


def section(suite: str, folder: Path) -> str:
    """Return the section of a suite, and write its curves."""
    scores = scores_of(folder)
    course = next(iter(scores.values()))[0].course
    shown = {name: scores[name] for name in SHOWN if name in scores}
    first_test = course.test_phases[0].name
    figures = []
    for key, text in CURVES:
        if key == "test":
            curves = {
                name: [test_curve(run.scores, course, first_test) for run in runs] for name, runs in shown.items()
            }
            text = text.format(first_test)
        else:
            online = {name: runs for name, runs in shown.items() if name != "shuffled"}  # it learns between phases
            curves = {name: [run[key]["curve"] for run in runs] for name, runs in online.items()}
        image = f"learning-{suite}-{key.replace('_', '-')}.svg"
        chart(curves, course, DOCS / "images" / image, f"{text}, suite {suite}")
        figures.append(f"**{text}**\n\n![{text}, suite {suite}](images/{image})")
    seeds = len(next(iter(scores.values())))
    phases = "; ".join(
        f"{phase.name} ({end - start} frames)"
        for phase, start, end in zip(course.phases, course.starts, course.starts[1:], strict=False)
    )
    command = f"tiscene evaluate {suite} --learner all --seeds {seeds} -o results/{suite}"
    return f"""## {suite}

Phases: {phases}. Seeds: {seeds}.

    {command}

{table(scores)}

{NEWLINES.join(figures)}

Lines: mean over seeds; bands: from the lowest to the highest. {legend()}.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description="Write docs/learning-results.md.")
    parser.add_argument("--scores", type=Path, help="folder with scores of each suite; default: evaluate now")
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_args()
    results = args.scores or Path("results")
    if args.scores is None:
        for suite in SUITES:
            if tiscene(["evaluate", suite, "--learner", "all", "--seeds", str(args.seeds), "-o", str(results / suite)]):
                raise SystemExit(1)
    ordered = [*SUITES, *(name for name in suites() if name not in SUITES)]
    present = [suite for suite in ordered if any((results / suite).glob("*-seed*.json"))]
    text = "\n".join([INTRODUCTION, *(section(suite, results / suite) for suite in present), NOTES])
    (DOCS / "learning-results.md").write_text(text, encoding="utf-8")


NOTES = """## Reading the tables

- **Learning**: within a phase, all learners that see pictures become more accurate, and on frames ahead as well.
- **Forgetting**: where a phase has other categories, the accuracy of `naive` falls at once, and that on tests of
  earlier phases falls to 0. It learns each phase nearly as well as `replay` does, which keeps most of the earlier ones.
- ACC orders the learners as expected on all suites: `naive`, then `replay`, then `shuffled`, several standard
  deviations apart on `room` and `home`.
- `blind` never looks at a picture. Its online accuracy is among the highest, since objects are near where they were
  labeled a frame before. Fifty frames ahead it is the lowest on `solids` and `room`, and so is its ACC. On `home`
  most pixels are wall and floor, which it places well: fifty frames ahead it is 3 points behind `naive`.
- `home` is the hardest: rooms come once, on the way, and few labels fall on small things. No learner has half of the
  test pixels right, as a mean over classes.
- `ewc`, `si` and `lwf` are not told of boundaries; they protect their weights every 200 steps. They keep hardly more
  than `naive`.
- `ncm` forgets less, but its features are colors: it fails where light changes.
- `flow` learns features without labels and trains its last layer alone. That learns more slowly, and forgets as `naive`
  does.
- FWT is negative by chance: an untrained network gives all pixels one category, which is right for one object. After a
  phase with other categories it gives those.
- Held out on `room` are the tests at night. Chairs and balls are never shown at night, and no learner finds them there.
- Standard deviations are those of three seeds of the learners on one course. They say nothing about other paths.
"""


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Results of an evaluation as one HTML page: tables, curves, accuracy matrices, frames. It refers to no other file."""

from __future__ import annotations

import base64
import io
import math
import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dynamics import argument_checks
from tiscene.errors import ArgumentError, counted, export_errors
from tiscene.files import write_atomically
from tiscene.frame.visualize import id_picture
from tiscene.learning.course import Course
from tiscene.learning.score import Score
from tiscene.learning.svg_chart import line_chart, line_styles

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 60rem; padding: 0 1rem; color: #1b1f24; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; } h3 { font-size: 1rem; margin-bottom: .3rem; }
table { border-collapse: collapse; margin: .6rem 0; } th, td { padding: .2rem .6rem; text-align: right; }
td { white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
thead th { border-bottom: 1px solid #8a939c; vertical-align: bottom; }
svg { width: 100%; height: auto; } svg text { font-size: 11px; fill: #444c56; }
svg polyline { fill: none; stroke-width: 1.8; }
.grid { stroke: #e3e6e9; } .mark { stroke: #8a939c; stroke-dasharray: 3 3; }
.legend span { display: inline-block; margin-right: 1.1rem; } .legend svg { width: 26px; height: 8px; }
.scroll { overflow-x: auto; } figure { display: inline-block; margin: 0 .4rem .6rem 0; }
img { image-rendering: pixelated; width: 192px; display: block; } figcaption { font-size: 12px; color: #444c56; }
.note { color: #444c56; max-width: 48rem; }
"""

COLUMNS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("online", "accuracy of each frame before it is learned", ("online", "accuracy")),
    ("near future", "the same, a gap of frames ahead", ("near_future", "accuracy")),
    ("focus", "online, at the focus of attention", ("focus", "accuracy")),
    ("ACC", "mean over the learned tests, after the last phase", ("tests", "class_accuracy", "ACC")),
    ("BWT", "backward transfer; negative: forgetting", ("tests", "class_accuracy", "BWT")),
    ("forgetting", "loss against the best so far", ("tests", "class_accuracy", "forgetting")),
    ("FWT", "forward transfer", ("tests", "class_accuracy", "FWT")),
    ("held out", "mean over tests of no phase", ("tests", "class_accuracy", "held_out")),
)


def write_page(path: str | os.PathLike[str], title: str, scores: Sequence[Score]) -> None:
    """Write the page.

    Args:
        path: of the HTML file.
        title: its heading.
        scores: of one or more learners; several scores of one name are runs of different seeds. Their courses have the
            same length and the same tests.

    Raises:
        ArgumentError: there are no scores, their courses differ in length or tests, or `title` is no text.
        ExportError: the file cannot be written.
    """
    if isinstance(scores, Mapping) or not scores or not all(isinstance(each, Score) for each in scores):
        raise ArgumentError(f"scores={scores!r}: must be a list of one or more scores")
    argument_checks.text(title, "title")
    path, course = Path(path), scores[0].course
    if len({(len(each.course), tuple(test.name for test in each.course.test_phases)) for each in scores}) > 1:
        raise ArgumentError("scores: their courses differ in length or tests; write a page for each course")
    by_name: dict[str, list[Score]] = {}
    for each in scores:
        by_name.setdefault(each.name, []).append(each)
    for name, runs in by_name.items():
        if any(run.course.events() != runs[0].course.events() for run in runs):
            raise ArgumentError(f"scores: their courses change at other frames; call them otherwise than {name!r}")
    styles = line_styles(list(by_name))
    courses = {each.course.digest(): each for each in reversed(scores)}  # usually one
    body = [
        f"<h1>{escape(title)}</h1>",
        *(
            _course(each.course) if len(courses) == 1 else f"<h3>{escape(each.name)}</h3>{_course(each.course)}"
            for each in reversed(courses.values())
        ),
        "<h2>Scores</h2>",
        _summary(by_name),
        "<h2>Accuracy over the course</h2>",
        *_curves(by_name, course, styles),
        *([_matrices(by_name), _examples(by_name)] if course.test_phases else []),
        *([_adaptation(by_name)] if course.events() else []),
        "<h2>Costs</h2>",
        _note("These figures depend on the machine. All others do not."),
        _costs(by_name),
    ]
    head = (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    )
    with export_errors(path):
        write_atomically(path, f"{head}\n<body>\n{chr(10).join(body)}\n</body></html>\n".encode())


def mean_and_deviation(values: Sequence[float | None]) -> tuple[float, float | None] | None:
    """Return mean and sample standard deviation; the deviation of one value is None. None: a value is missing."""
    if not values or any(value is None for value in values):
        return None
    numbers = np.array(values, np.float64)
    return float(numbers.mean()), float(numbers.std(ddof=1)) if len(numbers) > 1 else None


def value_of(scores: Mapping[str, Any], keys: Sequence[str]) -> float | None:
    """Return a value of nested mappings; None: it is missing."""
    found: Any = scores
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return None if found is None else float(found)


def percent(values: Sequence[float | None]) -> str:
    """Return fractions as mean ± standard deviation in percent; "–" where a value is missing."""
    found = mean_and_deviation(values)
    if found is None:
        return "–"
    mean, deviation = found
    return f"{100 * mean:.1f}" + ("" if deviation is None else f" ± {100 * deviation:.1f}")


def _course(course: Course) -> str:
    rows = [
        [phase.name, end - start, _teaching(phase), ", ".join(_drift(each) for each in phase.drift) or "–"]
        for phase, start, end in zip(course.phases, course.starts, course.starts[1:], strict=False)
    ]
    tests = ", ".join(phase.name for phase in course.test_phases) or "none"
    size = f"{course.width} × {course.height} px, {course.fps:g} frames per second, {counted(len(course), 'frame')}"
    categories = ", ".join(name for name in course.categories.values() if name)
    return _note(f"{size}. Categories: {categories}. Tests: {tests}.") + _table(
        ["Phase", "Frames", "Supervision", "Drift"], rows
    )


def _teaching(phase: Any) -> str:
    if phase.evaluate:
        return "none: test only"
    if phase.supervision is None:
        return "none"
    rules = phase.supervision
    default = type(rules)()
    fields = [name for name in rules.__dataclass_fields__ if name not in ("policy", "seed")]
    others = [f"{name} {getattr(rules, name)}" for name in fields if getattr(rules, name) != getattr(default, name)]
    return ", ".join([_policy(rules.policy), *others])


def _policy(policy: Any) -> str:
    parts = getattr(policy, "parts", None)
    if parts:
        return " + ".join(map(_policy, parts))
    inner = getattr(policy, "policy", None)
    count = getattr(policy, "count", None)
    inside = [str(count)] if count is not None else []
    return f"{type(policy).__name__}({', '.join([*inside, *([_policy(inner)] if inner else [])])})"


def _drift(drift: Any) -> str:
    return f"{drift.factor}: {drift.schedule}"


def _summary(by_name: Mapping[str, Sequence[Score]]) -> str:
    rows = [
        [
            name,
            *(percent([value_of(run.scores, keys) for run in runs]) for _, _, keys in COLUMNS),
            _labels(runs[0].labels),
        ]
        for name, runs in by_name.items()
    ]
    meanings = "; ".join(f"{name}: {meaning}" for name, meaning, _ in COLUMNS)
    seeds = max(map(len, by_name.values()))
    spread = f" Mean ± standard deviation of {seeds} seeds." if seeds > 1 else ""
    table = _table(["Learner", *(name for name, _, _ in COLUMNS), "labels"], rows)
    return _note(f"Percent.{spread} {meanings}; the last five are mean class accuracies.") + table


def _labels(labels: Mapping[str, Any]) -> str:
    late = labels.get("undelivered", 0)  # version 0.1 did not count them
    return f"{labels['given']}" + (f" ({late} never arrived)" if late else "")


def _curves(by_name: Mapping[str, Sequence[Score]], course: Course, styles: Mapping[str, tuple[str, str]]) -> list[str]:
    legend = "".join(
        f'<span><svg viewBox="0 0 26 8"><line x1="0" x2="26" y1="4" y2="4" stroke="{color}" stroke-width="3" '
        f'stroke-dasharray="{dash}"/></svg> {escape(name)}</span>'
        for name, (color, dash) in styles.items()
    )
    parts = [f'<p class="legend">{legend}</p>']
    if max(map(len, by_name.values())) > 1:
        parts.append(_note("Lines: mean over seeds. Bands: from the lowest to the highest."))

    def add(title: str, label: str, curves: Mapping[str, Sequence[Sequence[tuple[int, float]]]]) -> None:
        measured = {name: each for name, each in curves.items() if any(each)}
        if measured:
            lines, bands = mean_and_range(measured)
            drawn = line_chart(lines, end=len(course), marks=marks_of(course), colors=styles, label=label, bands=bands)
            parts.extend([f"<h3>{escape(title)}</h3>", drawn])

    for key, title in (("online", "Online"), ("near_future", "Near future"), ("online_frame", "Online, whole frame")):
        curves = {name: [run.scores.get(key, {}).get("curve", ()) for run in runs] for name, runs in by_name.items()}
        add(title, f"{title} accuracy", curves)
    if course.test_phases:
        parts.append(
            _note("Below: mean class accuracy of tests after each phase. Where a line falls, it is forgotten.")
        )
    for test in course.test_phases:
        curves = {name: [test_curve(run.scores, course, test.name) for run in runs] for name, runs in by_name.items()}
        add(f"Test: {test.name}", f"Accuracy of the test {test.name}", curves)
    return parts


def marks_of(course: Course) -> dict[int, str]:
    """Return the first frame of each phase and change of a factor, with its name."""
    return {0: course.phases[0].name} | {index: text.removeprefix("phase ") for index, text in course.events().items()}


def test_curve(scores: Mapping[str, Any], course: Course, test: str) -> list[tuple[int, float]]:
    """Return the mean class accuracy of a test after each phase, as pairs (first frame after the phase, accuracy)."""
    found = scores["tests"]
    ends = dict(zip((phase.name for phase in course.phases), course.starts[1:], strict=True))
    column = found["tests"].index(test)
    rows = zip(found["rows"], found["class_accuracy"]["R"], strict=True)
    # The row before the first phase has a name of its own.
    return [(ends.get(name, 0), row[column]) for name, row in rows if row[column] is not None]


def mean_and_range(
    curves: Mapping[str, Sequence[Sequence[tuple[int, float]]]],
) -> tuple[dict[str, list[tuple[float, float]]], dict[str, list[tuple[float, float, float]]]]:
    """Return the mean over seeds of curves by name, and the range from the lowest to the highest value."""
    lines: dict[str, list[tuple[float, float]]] = {}
    bands: dict[str, list[tuple[float, float, float]]] = {}
    for name, runs in curves.items():
        values: dict[int, list[float]] = {}
        for frame, value in (point for run in runs for point in run):
            values.setdefault(frame, []).append(value)
        lines[name] = [(frame, float(np.mean(values[frame]))) for frame in sorted(values)]
        if len(runs) > 1:
            bands[name] = [(frame, min(values[frame]), max(values[frame])) for frame in sorted(values)]
    return lines, bands


def _matrices(by_name: Mapping[str, Sequence[Score]]) -> str:
    note = _note("Rows: after a phase; columns: tests. Mean class accuracy in percent, mean over seeds.")
    tables = "".join(_matrix(name, runs) for name, runs in by_name.items())
    return f"<h2>Accuracy matrices</h2>{note}{tables}"


def _matrix(name: str, runs: Sequence[Score]) -> str:
    tests = runs[0].scores["tests"]
    R = np.array([run.scores["tests"]["class_accuracy"]["R"] for run in runs], np.float64)  # None becomes nan
    mean = np.ma.masked_invalid(R).mean(axis=0).filled(np.nan)
    cells = ["".join(map(_cell, row)) for row in mean.tolist()]
    head = "".join(f"<th>{escape(each)}</th>" for each in ("after", *tests["tests"]))
    rows = "".join(f"<tr><td>{escape(row)}</td>{line}</tr>" for row, line in zip(tests["rows"], cells, strict=True))
    return f'<h3>{escape(name)}</h3><div class="scroll"><table><thead><tr>{head}</tr></thead>{rows}</table></div>'


def _cell(value: float) -> str:
    """Return a cell of a matrix, from white (0) to blue (1); "–" for nan."""
    if math.isnan(value):
        return "<td>–</td>"
    red, green, blue = (round(255 + (end - 255) * value) for end in (0, 114, 178))
    color = "#fff" if value > 0.6 else "#1b1f24"
    return f'<td style="background: rgb({red} {green} {blue}); color: {color}">{100 * value:.0f}</td>'


def _adaptation(by_name: Mapping[str, Sequence[Score]]) -> str:
    rows = []
    for name, runs in by_name.items():
        if not all("adaptation" in run.scores for run in runs):
            continue
        for row in range(len(runs[0].scores["adaptation"]["events"])):
            events = [run.scores["adaptation"]["events"][row] for run in runs]
            before, drop = (percent([each[key] for each in events]) for key in ("before", "drop"))
            times = [_frames([each[key] for each in events]) for key in ("recovery", "adaptation")]
            rows.append([name, f"{events[0]['frame']}: {events[0]['change']}", before, drop, *times])
    note = _note(
        "Before and drop in percent; frames until the accuracy is back at 90 % of that before (recovery), and at 90 % "
        "of that at the end (adaptation). –: not before the next change."
    )
    table = _table(["Learner", "Change", "before", "drop", "recovery", "adaptation"], rows)
    return f"<h2>After each change</h2>{note}{table}"


def _frames(values: Sequence[int | None]) -> str:
    found = mean_and_deviation(values)
    return "–" if found is None else f"{found[0]:.0f}"


def _examples(by_name: Mapping[str, Sequence[Score]]) -> str:
    first = next(iter(by_name.values()))[0].examples
    rows = []
    for number, example in enumerate(first):
        figures = [] if example.rgb is None else [_figure(example.rgb, example.test)]
        figures.append(_figure(id_picture(example.truth), "true"))
        for name, runs in by_name.items():
            if number >= len(runs[0].examples):  # a score that was read has none
                continue
            each = runs[0].examples[number]
            right = (each.prediction == each.truth)[each.counted]
            share = f"{100 * right.mean():.0f} % of objects" if right.size else "no object in view"
            figures.append(_figure(id_picture(each.prediction), f"{name}: {share}"))
        rows.append(f"<div>{''.join(figures)}</div>")
    return "<h2>Examples after the last phase</h2>" + "".join(rows)


def _figure(picture: NDArray[np.uint8], caption: str) -> str:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    data = base64.b64encode(file.getvalue()).decode()
    text = escape(caption)
    return f'<figure><img src="data:image/png;base64,{data}" alt="{text}"><figcaption>{text}</figcaption></figure>'


def _costs(by_name: Mapping[str, Sequence[Score]]) -> str:
    rows = []
    for name, runs in by_name.items():
        used = runs[0].resources
        learn, predict = (used["wall_seconds"].get(key, 0.0) for key in ("learn", "predict"))
        calls = used["calls"].get("predict", 0) or 1
        stored = used["stored_bytes"]
        rows.append(
            [
                name,
                f"{learn:.1f}",
                f"{1000 * predict / calls:.1f}",
                f"{sum(used['cpu_seconds'].values()):.1f}",
                "–" if stored is None else f"{stored / 1024:,.0f}",
                runs[0].clock["skipped"],
            ]
        )
    head = ["Learner", "learning, s", "a prediction, ms", "processor, s", "stored, KiB", "missed frames"]
    return _table(head, rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    top = "".join(f"<th>{escape(each)}</th>" for each in head)
    lines = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead>{lines}</table></div>'


def _note(text: str) -> str:
    return f'<p class="note">{escape(text)}</p>'

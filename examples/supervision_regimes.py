# SPDX-License-Identifier: Apache-2.0
"""Three regimes of supervision on one stream: on request, only early in life, only at the end.

They are those of Tiezzi et al., "Stochastic Coherence Over Attention Trajectory For Continuous Learning In Video
Streams", IJCAI 2022, and of SAILenv's laboratory: an agent lives in a stream of moving objects and is told the category
of a few pixels. Each regime has the same number of labels; only the time at which they are given differs.

    python examples/supervision_regimes.py                          # all three, with the learner `naive`
    python examples/supervision_regimes.py --regime early --learner replay
    python examples/supervision_regimes.py --learner ncm --frames 60 --output regimes

`naive`, `replay` and `ncm` need PyTorch: pip install 'tiscene[torch]'. `blind` does not.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import tiscene as ts
from tiscene.learning import (
    Asked,
    FirstFrames,
    LastFrames,
    OnePixelPerMovingObject,
    Score,
    SupervisionRules,
    make_learner,
    write_page,
)

REGIMES = ("request", "early", "late")
OBJECTS = {"Sphere": (-0.5, 1.0), "Cone": (0.0, 1.3), "Torus": (0.5, 1.0)}


def stream_of_life() -> ts.Scenario:
    """Return a scenario in which three primitives take turns: each moves along its loop while the others rest."""
    objects = []
    for name, (x, y) in OBJECTS.items():
        corners = [(x, y, -1.8), (x + 0.3, y + 0.2, -2.2), (x - 0.3, y + 0.1, -2.6), (x, y - 0.3, -2.2)]
        path = [ts.Waypoint(corner, (0, 120 * row, 0)) for row, corner in enumerate(corners)]
        loop = ts.CatmullWaypoints(path, total_time=2.0)
        objects.append(ts.Object(name.lower(), name, dynamic=loop, scale=0.8, collide=False))
    return ts.Scenario("object_view", objects, timings=ts.WaitUntilComplete(0.0))


def rules(regime: str, frames: int, labels: int) -> SupervisionRules:
    """Return the rules of a regime for a life of so many frames, with a budget of so many labels."""
    if regime == "request":  # the learner asks, at most one label every other frame
        return SupervisionRules(Asked(), budget=labels, every=2)
    part = max(frames // 4, 1)
    policy = OnePixelPerMovingObject()
    unasked = FirstFrames(part, policy) if regime == "early" else LastFrames(part, policy)
    return SupervisionRules(unasked, budget=labels)


class AskingLearner:
    """A learner that asks for the label of the pixel where its prediction changes most often from frame to frame."""

    def __init__(self, learner: object) -> None:
        self.learner, self.last, self.changes = learner, None, None

    def predict(self, frame):
        return self.learner.predict(frame)

    def ask(self, frame):
        """Return the pixel whose color has changed most since the frame before: something moves there."""
        now = frame.rgb.astype(int)
        before, self.last = now if self.last is None else self.last, now
        change = abs(now - before).sum(axis=-1)
        return [divmod(int(change.argmax()), change.shape[1])] if change.max() > 30 else []

    def learn(self, frame, answers):
        self.learner.learn(frame, answers)


def run(regime: str, learner: str, frames: int, labels: int) -> Score:
    """Live through one regime and return the score."""
    life = stream_of_life()
    phases = [ts.Phase("life", life, frames=frames, supervision=rules(regime, frames, labels))]
    tests = [ts.Phase("life", life, frames=12, step=7, start=frames)]
    # The same frames in another light were never seen.
    tests.append(ts.Phase("dim", life.with_factor("illumination", -1.5), frames=12, step=7, start=frames))
    with ts.Course(phases, tests=tests, categories=tuple(name.lower() for name in OBJECTS)) as course:
        made = make_learner(learner, course.categories)
        return ts.evaluate(AskingLearner(made) if regime == "request" else made, course, name=f"{learner}, {regime}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Three regimes of supervision on one stream.")
    parser.add_argument("--regime", choices=REGIMES, action="append", help="default: all")
    parser.add_argument("--learner", default="naive", help="name of a baseline (default: %(default)s)")
    parser.add_argument("--frames", type=int, default=300, help="length of life (default: %(default)s)")
    parser.add_argument("--labels", type=int, default=75, help="budget of labels (default: %(default)s)")
    parser.add_argument("--output", default="regimes", help="folder of the page (default: %(default)s)")
    args = parser.parse_args()
    scores = [run(regime, args.learner, args.frames, args.labels) for regime in args.regime or REGIMES]
    print(f"{'regime':24} {'labels':>6} {'online':>7} {'test':>7} {'dim':>7}")
    for score in scores:
        tests = score["tests"]["class_accuracy"]["R"][-1]
        figures = [score["online"]["accuracy"], *tests]
        print(f"{score.name:24} {score.labels['given']:6} " + " ".join(f"{value:7.1%}" for value in figures))
    page = Path(args.output) / "index.html"
    write_page(page, "Three regimes of supervision", scores)
    print(page)


if __name__ == "__main__":
    main()

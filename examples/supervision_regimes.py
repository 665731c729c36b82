# SPDX-License-Identifier: Apache-2.0
"""Three regimes of supervision on one stream: on request, only early in life, only at the end.

They are those of Tiezzi et al., "Stochastic Coherence Over Attention Trajectory For Continuous Learning In Video
Streams", IJCAI 2022, and of SAILenv's laboratory: an agent lives in a stream of moving objects and is told the category
of a few pixels. In each lap of the stream every object moves once. A regime decides when there are labels: whenever the
learner asks, in the first lap, or in the last.

    python examples/supervision_regimes.py                          # all three, with the learner `replay`
    python examples/supervision_regimes.py --regime early --learner naive
    python examples/supervision_regimes.py --learner ncm --laps 2 --output regimes

`naive`, `replay` and `ncm` need PyTorch: pip install 'tiscene[torch]'. `blind` does not.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import tiscene as ts
from tiscene.learning import (
    Asked,
    Combined,
    FirstFrames,
    LastFrames,
    OnePixelPerMovingObject,
    RandomPixels,
    Score,
    SupervisionRules,
    lap_times,
    make_learner,
    write_page,
)

FPS = 25.0
REGIMES = ("request", "early", "late")
OBJECTS = {"Sphere": (-0.5, 1.0), "Cone": (0.0, 1.3), "Torus": (0.5, 1.0)}


def stream_of_life() -> ts.Scenario:
    """Return a scenario in which three primitives take turns: each moves along its loop while the others rest."""
    objects = []
    for name, (x, y) in OBJECTS.items():
        corners = [(x, y, -1.8), (x + 0.3, y + 0.2, -2.2), (x - 0.3, y + 0.1, -2.6), (x, y - 0.3, -2.2)]
        path = [ts.Waypoint(corner, (0, 120 * row, 0)) for row, corner in enumerate(corners)]
        loop = ts.CatmullWaypoints(path, total_time=1.2)
        objects.append(ts.Object(name.lower(), name, dynamic=loop, scale=0.8, collide=False))
    return ts.Scenario("object_view", objects, timings=ts.WaitUntilComplete(0.0))


def rules(regime: str, lap: int, labels: int) -> SupervisionRules:
    """Return the rules of a regime with laps of so many frames, and a budget of so many labels."""
    if regime == "request":  # the learner asks, in every other frame at most
        return SupervisionRules(Asked(), budget=labels, every=2)
    policy = Combined([OnePixelPerMovingObject(), RandomPixels(1)])
    return SupervisionRules(FirstFrames(lap, policy) if regime == "early" else LastFrames(lap, policy), budget=labels)


class AskingLearner:
    """A learner that asks for the label of the pixel that differs most from its usual color: something came there."""

    def __init__(self, learner: object) -> None:
        self.learner, self.usual = learner, None

    def predict(self, frame):
        return self.learner.predict(frame)

    def ask(self, frame):
        """Return the pixel to ask for, or none while the picture stands still."""
        now = frame.rgb.astype(float)
        self.usual = now if self.usual is None else 0.9 * self.usual + 0.1 * now
        change = abs(now - self.usual).sum(axis=-1)
        return [divmod(int(change.argmax()), change.shape[1])] if change.max() > 30 else []

    def learn(self, frame, answers):
        self.learner.learn(frame, answers)


def run(regime: str, learner: str, laps: int, labels: int) -> Score:
    """Live through one regime and return the score."""
    life = stream_of_life()
    lap = lap_times(life).frames(1, FPS)
    phases = [ts.Phase("life", life, laps=laps, supervision=rules(regime, lap, labels))]
    tests = [ts.Phase("life", life, frames=12, step=7, start=laps * lap)]
    # The same frames in another light were never seen.
    tests.append(ts.Phase("dim", life.with_factor("illumination", -1.5), frames=12, step=7, start=laps * lap))
    with ts.Course(phases, tests=tests, categories=tuple(name.lower() for name in OBJECTS), fps=FPS) as course:
        made = make_learner(learner, course.categories)
        return ts.evaluate(AskingLearner(made) if regime == "request" else made, course, name=f"{learner}, {regime}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Three regimes of supervision on one stream.")
    parser.add_argument("--regime", choices=REGIMES, action="append", help="default: all")
    parser.add_argument("--learner", default="replay", help="name of a baseline (default: %(default)s)")
    parser.add_argument("--laps", type=int, default=4, help="length of life (default: %(default)s)")
    parser.add_argument("--labels", type=int, default=180, help="budget of labels (default: %(default)s)")
    parser.add_argument("--output", default="regimes", help="folder of the page (default: %(default)s)")
    args = parser.parse_args()
    scores = [run(regime, args.learner, args.laps, args.labels) for regime in args.regime or REGIMES]
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

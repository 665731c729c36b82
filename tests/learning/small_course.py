# SPDX-License-Identifier: Apache-2.0
"""A course of 28 small frames, and learners that are quick."""

import numpy as np

from dynamics import CatmullWaypoints, Waypoint
from tiscene.learning.course import Course
from tiscene.learning.phase import Phase
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Combined, OnePixelPerMovingObject, RandomPixels
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario

SETTINGS = {"width": 24, "height": 18, "buffers": ("semantic", "instance", "part", "depth", "albedo")}

SMALL = {"width": 32, "height": 24, "buffers": ("semantic", "instance", "part", "depth"), "observed": ("depth",)}


def same(a, b):
    """Return whether two frames have equal bytes in all buffers of the second."""
    return all(a[name].tobytes() == b[name].tobytes() for name in b)


def scenario(template="Ball 01", total_time=1.0, scene="object_view", **others):
    """Return a scenario of one object on a closed curve."""
    path = [Waypoint((-0.6, 0.9, -2)), Waypoint((0.6, 1.2, -2)), Waypoint((0, 0.6, -2.4))]
    moving = Object("mover", template, dynamic=CatmullWaypoints(path, total_time=total_time), collide=False)
    return Scenario(scene, [moving], **others)


TAUGHT = SupervisionRules(Combined([OnePixelPerMovingObject(), RandomPixels(2)]))
BALL, CHAIR = scenario("Ball 01"), scenario("Chair 01")


def make_course(**others):
    tests = [
        Phase("ball", BALL, frames=3, start=13),
        Phase("chair", CHAIR, frames=3, start=13),
        Phase("plant", scenario("Plant 01"), frames=2),
    ]
    return Course(
        [
            Phase("ball", BALL, frames=12, supervision=TAUGHT),
            Phase("chair", CHAIR, frames=12, supervision=TAUGHT),
            Phase("exam", BALL, frames=4, evaluate=True),
        ],
        **(SETTINGS | {"observed": ("albedo",), "tests": tests} | others),
    )


class Constant:
    """Predicts one category, and records its calls."""

    def __init__(self, number=0):
        self.number, self.calls = number, []

    def predict(self, frame):
        self.calls.append(("predict", frame.index))
        return np.full(frame[next(iter(frame))].shape[:2], self.number)

    def learn(self, frame, answers):
        self.calls.append(("learn", frame.index, len(answers)))


class Oracle(Constant):
    """Reads the labels, which it may observe."""

    def predict(self, frame):
        super().predict(frame)
        return frame.semantic


class NearestAlbedo:
    """Predicts the category whose last labels have the nearest albedo; deterministic."""

    def __init__(self, categories=None, seed=0):
        self.seed, self.known = seed, []

    def predict(self, frame):
        colors = frame.albedo.reshape(-1, 3)
        if not self.known:
            return np.zeros(frame.albedo.shape[:2], int)
        known = np.array([color for color, _ in self.known])
        nearest = np.argmin(np.square(colors[:, None] - known).sum(axis=2), axis=1)
        return np.array([number for _, number in self.known])[nearest].reshape(frame.albedo.shape[:2])

    def learn(self, frame, answers):
        self.known = [*self.known, *((frame.albedo[each.pixel], each.category_id) for each in answers)][-40:]

    def state_dict(self):
        return {"known": self.known}

    def load_state_dict(self, state):
        self.known = state["known"]

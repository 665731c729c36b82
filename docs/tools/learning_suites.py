# SPDX-License-Identifier: Apache-2.0
"""Write the courses of the benchmark suites, tiscene/learning/suites/*.json.

    python -m docs.tools.learning_suites            # all
    python -m docs.tools.learning_suites solids     # those of one suite

Each suite has the grades easy, medium and hard, which differ in the number, size and speed of objects and in drift.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tiscene as ts
from tiscene.learning.course import Course
from tiscene.learning.drift import Cycle, Drift, Ramp
from tiscene.learning.held_out_tests import counterfactuals
from tiscene.learning.phase import Phase
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Combined, OnePixelPerMovingObject, RandomPixels
from usd_scenes.author.home_01 import WALK

FOLDER = Path(ts.__file__).parent / "learning" / "suites"
TAUGHT = SupervisionRules(Combined([OnePixelPerMovingObject(), RandomPixels(2)]))
TESTED = {"frames": 16, "step": 20}
COPIES = 2  # of each template of the suite room


@dataclass(frozen=True)
class Grade:
    """How hard a suite is.

    Attributes:
        name: its name.
        objects: templates that move in a phase.
        size: least size of an object, as a fraction of the image's height.
        depth: distances from the camera, m.
        speed: m/s.
        spin: rad/s.
        frames: of a phase.
    """

    name: str
    objects: int
    size: float
    depth: tuple[float, float]
    speed: tuple[float, float]
    spin: tuple[float, float]
    frames: int = 250


GRADES = (
    Grade("easy", 1, 0.25, (1.0, 2.5), (0.2, 0.4), (0.1, 0.5)),
    Grade("medium", 2, 0.15, (1.0, 3.0), (0.3, 0.8), (0.3, 1.2)),
    Grade("hard", 2, 0.08, (1.2, 4.5), (0.6, 1.6), (1.0, 3.0)),
)


def moving(scene: str, templates: Sequence[str], grade: Grade, seed: int, copies: int = 1) -> ts.Scenario:
    """Return a scenario in which objects of each template move, each on a random loop of its own.

    Args:
        scene: name of the scene.
        templates: of which the grade takes the first ones.
        grade: ranges of size, distance and speed.
        seed: of all loops.
        copies: objects of each template. More of them show it from more sides.
    """
    objects: list[ts.Object] = []
    for row, template in enumerate(templates[: grade.objects] * copies):
        drawn = ts.Scenario.sample(
            scene,
            seed=100 * seed + row,
            objects=1,
            templates=[template],
            depth=grade.depth,
            min_size=grade.size,
            speed=grade.speed,
            angular_speed=grade.spin,
            waypoints=(5, 8),
        )
        name = template.lower().replace(" ", "_")
        if copies > 1:
            name += f"_{row // len(templates[: grade.objects]) + 1}"
        objects.append(replace(drawn.objects[0], id=name, collide=False))
    return ts.Scenario(scene, objects)


def course(
    phases: Sequence[Phase], tests: Sequence[Phase], categories: Sequence[str], pixels: str = "objects"
) -> Course:
    """Return a course with the settings of all suites."""
    return Course(
        phases,
        tests=tests,
        observed=("rgb", "forward_flow"),
        buffers=("rgb", "semantic", "instance", "part", "depth", "forward_flow"),
        categories=tuple(categories),
        pixels=pixels,
        width=64,
        height=48,
        quality="fast",
    )


def solids(grade: Grade) -> Course:
    """Return a course of primitives, two new ones in each phase; the first ones come back, in fading light."""
    scene = "solid_benchmark" if grade.name == "hard" else "object_view"
    groups = [("Cone", "Capsule"), ("Torus", "Plant 01"), ("Pillow 01", "Ball 01")]
    if grade.name != "hard":  # there, spheres, cubes and cylinders stand in the scene
        groups = [("Sphere", "Cube"), ("Cone", "Cylinder"), ("Torus", "Capsule")]
    return _classes_in_turn(scene, groups, grade, dim=Drift("illumination", (0.0, -2.0), Ramp(60, 180, steps=3)))


def room(grade: Grade) -> Course:
    """Return a course in one room: two groups of objects in turn, day and night, other instances, clutter."""
    scene = "room_02"
    first, second = ("Chair 01", "Ball 01"), ("Teddy Bear 01", "Suitcase 01")
    a, b = (moving(scene, group, grade, seed, COPIES) for seed, group in enumerate((first, second), 1))
    others = [replace(each, template="Chair 02") if each.template == "Chair 01" else each for each in a.objects]
    other = replace(a, objects=others)
    n = grade.frames
    night = Drift("illumination", ("day", "night"), Cycle(n // 2))
    phases = [
        Phase(_title(a), a, frames=n, supervision=TAUGHT),
        Phase(_title(b), b, frames=n, supervision=TAUGHT),
        Phase("day and night", b, frames=n, supervision=TAUGHT, drift=night, start=n),
        Phase("other chair", other, frames=n, supervision=TAUGHT),
        Phase("clutter", b.with_factor("clutter", 6, seed=1), frames=n, supervision=TAUGHT, start=2 * n),
    ]
    if grade.name == "easy":
        phases = phases[:4]
    tests = [
        Phase(_title(scenario), moving(scene, group, grade, seed, COPIES), **TESTED)
        for scenario, group, seed in ((a, first, 11), (b, second, 12))
    ]
    tests += counterfactuals(tests, {"illumination": ["night"]}, **TESTED)
    names = ["chair", "ball", "teddy bear", "suitcase"]
    return course(phases, tests, names)


def home(grade: Grade) -> Course:
    """Return a course in which the camera walks from room to room, twice; what it sees there is labeled.

    Everything that a phase shows stands in the home; a phase is the way to a room and back.
    """
    stops = [ts.Waypoint((x, 1.5, z), (0.0, yaw, 0.0)) for x, z, yaw in WALK]
    seconds = {"easy": 50.0, "medium": 40.0, "hard": 30.0}[grade.name]  # of a walk
    walk = ts.CatmullWaypoints(stops, total_time=seconds, rotation="euler")
    camera = ts.Camera((0.0, 1.5, 0.0), vertical_fov=1.05, exposure=2.8, dynamic=walk)
    scenario = ts.Scenario("home_01", camera=camera)
    lap = round(seconds * 25)
    # Shares of the walk: to the bedroom, to the bathroom, to the kitchen.
    marks = [0, round(0.37 * lap), round(0.57 * lap), lap]
    names = ("living room, bedroom", "bathroom", "kitchen")
    spans = list(zip(names, marks, marks[1:], strict=False))
    taught = SupervisionRules(RandomPixels(4))
    phases = [Phase(name, scenario, frames=b - a, start=a, supervision=taught) for name, a, b in spans]
    if grade.name != "easy":
        night = scenario.with_factor("illumination", "night")
        phases += [Phase("night", night, frames=marks[1], supervision=taught)]
    tests = [Phase(name, scenario, frames=12, start=a + 5, step=(b - a) // 12) for name, a, b in spans]
    tests += counterfactuals(tests[-1:], {"illumination": ["evening"]}, frames=12, start=marks[2] + 5, step=30)
    categories = [
        "wall",
        "floor",
        "ceiling",
        "door",
        "window",
        "sofa",
        "bed",
        "wardrobe",
        "washbasin",
        "toilet",
        "curtain",
    ]
    return course(phases, tests, categories, pixels="frame")


def _classes_in_turn(scene: str, groups: Sequence[Sequence[str]], grade: Grade, dim: Drift) -> Course:
    scenarios = [moving(scene, group, grade, seed) for seed, group in enumerate(groups, 1)]
    phases = [Phase(_title(each), each, frames=grade.frames, supervision=TAUGHT) for each in scenarios]
    again = replace(moving(scene, groups[0], grade, 21))
    phases.append(Phase("again, dimmed", again, frames=grade.frames, supervision=TAUGHT, drift=[dim]))
    tests = [
        Phase(_title(each), moving(scene, group, grade, seed), **TESTED)
        for seed, (each, group) in enumerate(zip(scenarios, groups, strict=True), 11)
    ]
    tests += counterfactuals(tests[:1], {"illumination": [-2.0]}, **TESTED)
    categories = [ts.templates()[each.template].category for scenario in scenarios for each in scenario.objects]
    return course(phases, tests, categories)


def _title(scenario: ts.Scenario) -> str:
    return ", ".join(dict.fromkeys(ts.templates()[each.template].category for each in scenario.objects))


SUITES: dict[str, Callable[[Grade], Course]] = {"solids": solids, "room": room, "home": home}


def main(names: Sequence[str]) -> None:
    FOLDER.mkdir(exist_ok=True)
    for name in names or SUITES:
        for grade in GRADES:
            path = FOLDER / f"{name}-{grade.name}.json"
            made = SUITES[name](grade)
            made.save(path)
            print(path.name, len(made), "frames")


if __name__ == "__main__":
    main(sys.argv[1:])

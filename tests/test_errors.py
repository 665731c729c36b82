# SPDX-License-Identifier: Apache-2.0
"""The exception tree matches the one drawn in its docstring, and messages help."""

import inspect
import pickle
import re
from pathlib import Path

import pytest

import tiscene as ts
from dynamics import errors as dynamics_errors
from tiscene import errors
from tiscene.errors import (
    ArgumentError,
    ArgumentTypeError,
    BufferNotFound,
    MissingFile,
    StageError,
    TisceneError,
    UnknownName,
    counted,
)

LINE = re.compile(r"^(?P<indent>[ │]*)(?:[├└]── )?(?P<name>[A-Z]\w+)(?: \((?P<bases>\w+(?:, \w+)*)\))?(?:  +\S.*)?$")


def drawn_tree() -> dict[str, set[str]]:
    """Map the name of each class to the names of its bases, as drawn in the docstring."""
    tree, above = {}, {}
    for line in inspect.getdoc(errors).splitlines():
        match = LINE.match(line.removeprefix("    ")) if line.startswith("    ") else None
        if match is None:
            continue
        depth = (match.start("name")) // 4
        above[depth] = match["name"]
        parents = {above[depth - 1]} if depth else set()
        tree[match["name"]] = parents | set((match["bases"] or "").split(", ")) - {""}
    return tree


def test_docstring_draws_the_actual_exception_tree():
    classes = {
        name: value
        for name, value in vars(errors).items()
        if inspect.isclass(value) and value.__module__ in (errors.__name__, dynamics_errors.__name__)
    }
    real = {name: {base.__name__ for base in value.__bases__} for name, value in classes.items()}
    real["TisceneError"].remove("Exception")
    assert drawn_tree() == real


@pytest.mark.parametrize("name", [name for name in drawn_tree() if name != "StageWarning"])
def test_every_error_is_a_tiscene_error_with_a_docstring(name):
    assert issubclass(getattr(errors, name), TisceneError)
    assert getattr(errors, name).__doc__


def test_argument_errors_of_dynamics_and_tiscene_are_the_same_classes():
    assert errors.TisceneError is dynamics_errors.TisceneError
    assert errors.ArgumentError is dynamics_errors.ArgumentError
    assert errors.ArgumentTypeError is dynamics_errors.ArgumentTypeError


TWO = (ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0)))


@pytest.mark.parametrize(
    ("construct", "message", "kind"),
    [
        (lambda: ts.Waypoint("x"), "position='x': must be 3 numbers", ArgumentTypeError),
        (lambda: ts.Waypoint((0, 0)), "position=.*must be 3 numbers, not 2", ArgumentError),
        (lambda: ts.LinearWaypoints(3), "waypoints=3: must be a sequence", ArgumentTypeError),
        (lambda: ts.CatmullWaypoints([]), "waypoints: .*2 or more, not 0", ArgumentError),
        (lambda: ts.Keyframes((0, -1), TWO), "times=.*increase", ArgumentError),
        (lambda: ts.Orbit(period=0), "period=0: must be greater than 0", ArgumentError),
        (lambda: ts.LookAt((0, 0, 0), motion=3), "motion=3: must be a Dynamic", ArgumentTypeError),
        (lambda: ts.Composite([]), "parts", ArgumentError),
        (lambda: ts.UniformMovementRandomBounce(speed=-1), "speed=-1: must not be negative", ArgumentError),
        (lambda: ts.UniformMovementRandomBounce(seed=0.5), "seed=0.5: must be a whole number", ArgumentTypeError),
        (lambda: ts.AllTogether(-1), "wait_time=-1: must not be negative", ArgumentError),
        (lambda: ts.AllTogether("1"), "wait_time='1': must be a number", ArgumentTypeError),
        (lambda: ts.WaitUntilComplete(1, repeat="no"), "repeat='no': must be True or False", ArgumentTypeError),
        (lambda: ts.DictTimings({}), "times", ArgumentError),
        (lambda: ts.DictTimings(3), "times=3", ArgumentTypeError),
    ],
)
def test_constructors_raise_argument_errors_that_name_the_argument(construct, message, kind):
    with pytest.raises(TisceneError, match=message) as caught:
        construct()
    assert isinstance(caught.value, ValueError)
    assert type(caught.value) is kind
    assert isinstance(caught.value, TypeError) == (kind is ArgumentTypeError)


def test_unknown_name_suggests_the_nearest_known_name():
    message = str(UnknownName("buffer", "dept", ["rgb", "depth"], " in frame 3", "Ask for it."))
    assert message == "no buffer 'dept' in frame 3. Did you mean 'depth'? Ask for it."
    assert "Did you mean 'Chair 01'?" in str(UnknownName("template", "CHAIR 01", ["Chair 01", "Dish 01"]))
    assert "Did you mean 'Chair 01'?" in str(UnknownName("template", "chair", ["Armchair 01", "Chair 01"]))


def test_unknown_name_without_near_match_lists_known_names_if_few():
    assert str(UnknownName("buffer", "xyz", ["rgb", "depth"])) == "no buffer 'xyz'. There are: depth, rgb."
    assert str(UnknownName("buffer", "?", [f"name {k}" for k in range(31)])) == "no buffer '?'."
    assert str(UnknownName("camera", "Front", [])) == "no camera 'Front'."
    assert str(UnknownName("camera", 3, ["Front"])) == "no camera 3. There are: Front."


def test_unknown_name_keeps_the_requested_and_the_known_names():
    error = UnknownName("buffer", "dept", {"rgb": 1, "depth": 2})
    assert error.name == "dept"
    assert error.known == ["depth", "rgb"]


def test_stage_error_lists_all_problems():
    one = StageError("room.usda", ["</Room/Rug> material: no"])
    two = StageError("room.usda", ["</Room/Rug> material: no", "</Room/Lamp> mesh: no"])
    assert str(one) == "room.usda has 1 problem:\n  </Room/Rug> material: no"
    assert str(two).startswith("room.usda has 2 problems:\n")
    assert two.problems == ("</Room/Rug> material: no", "</Room/Lamp> mesh: no")


@pytest.mark.parametrize(
    "error",
    [
        BufferNotFound("buffer", "dept", ["depth"], " in frame 3"),
        StageError("room.usda", ["</Room> mesh: no"]),
        ArgumentError("width=0: must be from 1 to 16384"),
        ArgumentTypeError("width='wide': must be a whole number"),
        MissingFile("no file 'a.usda'"),
    ],
)
def test_errors_survive_pickling(error):
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy), copy.__dict__) == (type(error), str(error), error.__dict__)


def test_numbers_have_the_singular_and_the_plural_of_what_is_counted():
    assert [counted(number, "frame") for number in (0, 1, 2000)] == ["0 frames", "1 frame", "2,000 frames"]
    assert [counted(number, "mesh is", "meshes are") for number in (1, 3)] == ["1 mesh is", "3 meshes are"]


def test_messages_count_with_the_singular_and_the_plural():
    """As `counted` does: f"{len(missing)} frames are missing" says "1 frames are missing"."""
    naked = re.compile(r"\{(?:len|sum)\([^{}]*\)(?::,)?\} (?:[a-z]+ )?[a-z]+s\b")
    root = Path(ts.__file__).parents[1]
    files = [path for name in ("tiscene", "dynamics") for path in (root / name).rglob("*.py")]
    found = [f"{path.relative_to(root)}: {each}" for path in files for each in naked.findall(path.read_text("utf-8"))]
    assert found == []

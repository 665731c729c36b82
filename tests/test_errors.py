# SPDX-License-Identifier: Apache-2.0
"""The tree of errors is the one that its docstring draws, and the messages help."""

import inspect
import pickle
import re

import pytest

from tiscene import errors
from tiscene.errors import ArgumentError, BufferNotFound, MissingFile, StageError, TisceneError, UnknownName

LINE = re.compile(r"^(?P<indent>[ │]*)(?:[├└]── )?(?P<name>[A-Z]\w+)(?: \((?P<base>\w+)\))?(?:  +\S.*)?$")


def drawn_tree() -> dict[str, set[str]]:
    """Class name to the names of its bases, as drawn in the docstring."""
    tree, above = {}, {}
    for line in inspect.getdoc(errors).splitlines():
        match = LINE.match(line.removeprefix("    ")) if line.startswith("    ") else None
        if match is None:
            continue
        depth = (match.start("name")) // 4
        above[depth] = match["name"]
        parents = {above[depth - 1]} if depth else set()
        tree[match["name"]] = parents | ({match["base"]} if match["base"] else set())
    return tree


def test_the_tree_drawn_is_the_tree_there_is():
    classes = {
        name: value
        for name, value in vars(errors).items()
        if inspect.isclass(value) and value.__module__ == errors.__name__
    }
    real = {name: {base.__name__ for base in value.__bases__} for name, value in classes.items()}
    real["TisceneError"].remove("Exception")
    assert drawn_tree() == real


@pytest.mark.parametrize("name", [name for name in drawn_tree() if name != "StageWarning"])
def test_one_base_catches_all(name):
    assert issubclass(getattr(errors, name), TisceneError)
    assert getattr(errors, name).__doc__


def test_unknown_names_tell_the_nearest():
    message = str(UnknownName("buffer", "dept", ["rgb", "depth"], " in frame 3", "Ask for it."))
    assert message == "no buffer 'dept' in frame 3. Did you mean 'depth'? Ask for it."
    assert "Did you mean 'Chair 01'?" in str(UnknownName("template", "CHAIR 01", ["Chair 01", "Dish 01"]))


def test_without_a_near_one_a_short_list_is_told_and_a_long_one_is_not():
    assert str(UnknownName("buffer", "xyz", ["rgb", "depth"])) == "no buffer 'xyz'. There are: depth, rgb."
    assert str(UnknownName("buffer", "?", [f"name {k}" for k in range(31)])) == "no buffer '?'."
    assert str(UnknownName("camera", "Front", [])) == "no camera 'Front'."
    assert str(UnknownName("camera", 3, ["Front"])) == "no camera 3. There are: Front."


def test_what_was_asked_for_can_be_read_from_the_error():
    error = UnknownName("buffer", "dept", {"rgb": 1, "depth": 2})
    assert error.name == "dept"
    assert error.known == ["depth", "rgb"]


def test_a_stage_lists_all_its_problems():
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
        MissingFile("no file 'a.usda'"),
    ],
)
def test_a_worker_process_can_hand_it_on(error):
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy), copy.__dict__) == (type(error), str(error), error.__dict__)

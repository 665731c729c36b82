# SPDX-License-Identifier: Apache-2.0
import pytest

from tiscene.errors import StageWarning
from tiscene.world.category_ids import CategoryIds

REGISTERED = {"chair": 1, "table": 2, "wall": 3}


def test_registered_categories_keep_their_ids_in_any_order():
    ids = CategoryIds(REGISTERED, 100)
    assert [ids.of(name) for name in ("wall", "chair", "", "wall")] == [3, 1, 0, 3]
    assert ids.names == {0: "", 3: "wall", 1: "chair"}


def test_other_categories_are_numbered_from_first_new_in_order_of_first_use():
    ids = CategoryIds(REGISTERED, 100)
    assert [ids.of(name) for name in ("robot", "table", "arch", "robot")] == [100, 2, 101, 100]
    assert ids.names == {0: "", 100: "robot", 2: "table", 101: "arch"}
    assert [CategoryIds().of(name) for name in ("robot",)] == [1]


def test_selection_numbers_its_categories_and_gives_others_zero():
    ids = CategoryIds(REGISTERED, 100, ("wall", "robot"))
    assert [ids.of(name) for name in ("chair", "robot", "wall", "", "arch")] == [0, 2, 1, 0, 0]
    assert ids.names == {0: "", 1: "wall", 2: "robot"}


def test_selection_may_name_registered_seen_and_other_known_categories_and_warns_of_others():
    ids = CategoryIds(REGISTERED, 100, ("wall", "robot", "lift"))
    with pytest.warns(StageWarning, match=r"nothing here is 'robot', 'lift': ids that no pixel has so far \(`tiscene"):
        ids.warn_of_absent()
    ids.of("robot")
    with pytest.warns(StageWarning, match=r"nothing here is 'lift': "):
        ids.warn_of_absent()
    ids.warn_of_absent(["lift"])
    CategoryIds(REGISTERED).warn_of_absent()
    with pytest.warns(StageWarning, match=r"nothing here is 'chiar'; did you mean 'chair'\?: "):
        CategoryIds(REGISTERED, 100, ("wall", "chiar")).warn_of_absent()

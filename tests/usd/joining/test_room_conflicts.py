# SPDX-License-Identifier: Apache-2.0
"""Rooms that contradict each other in what holds for a whole stage."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from tests.usd.helpers import write
from tiscene.errors import StageError, StageWarning
from tiscene.usd import RoomPlacement, join

SCENE = """
    def PhysicsScene "Physics" {
        float physics:gravityMagnitude = %s
    }"""


def rooms_of(folder: Path, *contents: str, meters: tuple[float, ...] = (1.0, 1.0)) -> list[RoomPlacement]:
    """Write rooms a, b and so on with some contents each."""
    rooms = []
    for number, content in enumerate(contents):
        name, body = "ab"[number], f'def Xform "Room"\n{{{content}\n    def Cube "Box" {{}}\n}}'
        more = 'defaultPrim = "Room"'
        file = write(folder, body, name=f"{name}.usda", meters=meters[number], more=more)
        rooms.append(RoomPlacement(file, (5.0 * number, 0.0, 0.0)))
    return rooms


def test_gravity_of_other_rooms_that_differs_is_named(tmp_path: Path) -> None:
    with pytest.warns(StageWarning, match=r"the gravity of the room a counts, which is another one than in b$"):
        join(rooms_of(tmp_path, SCENE % 3, SCENE % "-inf"), tmp_path / "home.usda")


@pytest.mark.parametrize("strengths", [(9.81, "-inf"), (1.62, 1.62)])
def test_equal_gravity_is_not_named(tmp_path: Path, strengths: tuple[object, object]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        join(rooms_of(tmp_path, *(SCENE % each for each in strengths)), tmp_path / "home.usda")


def test_equal_gravity_in_different_units_is_not_named(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        join(rooms_of(tmp_path, SCENE % 3, SCENE % 300, meters=(1.0, 0.01)), tmp_path / "home.usda")


def test_room_without_a_physics_scene_beside_one_with_it_is_named(tmp_path: Path) -> None:
    with pytest.warns(StageWarning, match=r"a has no PhysicsScene, unlike the room b, whose gravity"):
        join(rooms_of(tmp_path, "", SCENE % 3), tmp_path / "home.usda")


def test_two_scenarios_are_refused(tmp_path: Path) -> None:
    scenario = """
    def Scope "Scenario" (prepend apiSchemas = ["TisceneScenarioAPI"]) {}"""
    with pytest.raises(StageError, match=r"the rooms a, b have a scenario each \(TisceneScenarioAPI\)"):
        join(rooms_of(tmp_path, scenario, scenario), tmp_path / "home.usda")
    assert not (tmp_path / "home.usda").exists()

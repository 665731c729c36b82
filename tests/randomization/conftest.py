# SPDX-License-Identifier: Apache-2.0
"""Rooms and scenarios that several modules vary."""

from __future__ import annotations

import pytest

from tests.randomization.rooms import WALLS, write_room, write_room_of_boxes
from tiscene.scenario.scenario import Scenario


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_room(tmp_path_factory.mktemp("room"), (0, 2, 3.5), WALLS)


@pytest.fixture(scope="session")
def room_of_boxes(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_room_of_boxes(tmp_path_factory.mktemp("room"))


@pytest.fixture(scope="session")
def drawn() -> Scenario:
    return Scenario.sample("solid_benchmark", seed=3, objects=2, templates=("Cup 01", "Chair 02"), scale=0.5)

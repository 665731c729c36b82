# SPDX-License-Identifier: Apache-2.0
"""A room and a template as files, for tests of scenarios on stages."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.usd.helpers import write
from tests.usd.scenario.room_stage import BLOCK, ROOM


@pytest.fixture
def room(tmp_path: Path) -> Path:
    write(tmp_path, BLOCK, name="block.usda", more='defaultPrim = "Block"')
    return write(tmp_path, ROOM, name="room.usda", more='defaultPrim = "Room"')

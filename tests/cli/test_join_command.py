# SPDX-License-Identifier: Apache-2.0
"""`tiscene join`: the stage that `join` writes, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.usd.joining.rooms import write_room
from tiscene.cli import main as cli
from tiscene.cli.join_arguments import opening, room
from tiscene.usd import Opening, RoomPlacement, join


def test_command_writes_the_stage_that_join_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, target = write_room(tmp_path, "room"), tmp_path / "home.usda"
    arguments = ["join", f"{file}@name=west", f"{file}@4.4,0,0,yaw=180,name=east", "-o", str(target), "--name", "Home"]
    arguments += ["--opening", "2.2,0,0,depth=0.4,yaw=90,lined=no", "--sky", "east"]
    assert cli.main(arguments) == 0
    assert capsys.readouterr().out == f"{target}\n"
    rooms = [RoomPlacement(file, name="west"), RoomPlacement(file, (4.4, 0.0, 0.0), 180.0, "east")]
    passage = Opening((2.2, 0.0, 0.0), depth=0.4, yaw=90.0, lined=False)
    twin = join(rooms, tmp_path / "twin.usda", openings=[passage], name="Home", sky="east")
    assert target.read_text() == twin.read_text()


def test_a_stage_is_replaced_only_when_the_command_is_told_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, target = write_room(tmp_path, "room"), tmp_path / "home.usda"
    target.write_text("mine")
    arguments = ["join", str(file), "-o", str(target)]
    assert cli.main(arguments) == 2
    assert f"{target} exists already: write another file, or --overwrite it" in capsys.readouterr().err
    assert target.read_text() == "mine"
    assert cli.main([*arguments, "--overwrite"]) == 0
    assert target.read_text().startswith("#usda")


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("room_04", {"file": "room_04"}),
        ("a,b=c.usda", {"file": "a,b=c.usda"}),
        ("me@work.usda@-.5,0,1e-1", {"file": "me@work.usda", "position": (-0.5, 0.0, 0.1)}),
        ("room_04@yaw=-90", {"file": "room_04", "yaw": -90.0}),
    ],
)
def test_room_has_a_file_and_a_place(text: str, fields: dict[str, Any]) -> None:
    assert room(text) == fields


@pytest.mark.parametrize("text", ["a@", "me@work.usda", "a@1,2", "a@1,2,3,4", "a@1,2,3,pitch=2", "a@1,2,3,yaw=x"])
def test_wrong_place_of_a_room_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["join", text, "-o", "home.usda"])
    assert f"'{text}' is not ROOM[@[X,Y,Z]" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["1,2", "depth=1", "1,2,3,lined=1", "1,2,3,size=2", "-1,2,x", "1,2,3,depth"])
def test_wrong_opening_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["join", "room_04", "--opening", text, "-o", "home.usda"])
    assert f"'{text}' is not X,Y,Z[,width=M]" in capsys.readouterr().err


def test_opening_with_a_negative_position() -> None:
    assert opening("-1,0,2,width=1.2") == {"position": (-1.0, 0.0, 2.0), "width": 1.2}

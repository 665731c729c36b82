# SPDX-License-Identifier: Apache-2.0
"""Templates that are files of unknown origin: read within the root folder and, like the stage, in another process."""

from __future__ import annotations

import json

import pytest

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import StageError
from tiscene.export import export
from tiscene.usd.core import layers
from tiscene.usd.read import template

SMALL = {"width": 8, "height": 6, "buffers": ("instance",)}
CAMERA = 'def Camera "Main" {}\n'
BALL = 'def Sphere "Ball" (kind = "component") {}\n'


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Return the path of a scene from the working directory, which holds a template that is outside of its folder."""
    (tmp_path / "inside").mkdir()
    write(tmp_path / "inside", CAMERA, name="scene.usda")
    write(tmp_path / "inside", BALL, name="ball.usda", more='defaultPrim = "Ball"')
    write(tmp_path, BALL, name="ball.usda", more='defaultPrim = "Ball"')
    monkeypatch.chdir(tmp_path)
    return "inside/scene.usda"


def names(stream: ts.Stream) -> list[str]:
    return [row.template for row in stream[0].objects]


def test_templates_outside_of_the_root_are_refused(scene):
    outside = ts.Object("a", "ball.usda", (0, 0, -5))
    with pytest.raises(StageError, match=r"layer @.*ball\.usda@ is outside .*inside"):
        ts.Stream(ts.Scenario(scene, [outside]), root="inside", **SMALL)
    stream = ts.Stream(scene, root="inside", **SMALL)
    with pytest.raises(StageError, match="is outside"):
        stream.world.spawn("ball.usda", (0, 0, -5))
    free = ts.Stream(scene, **SMALL)
    free.world.spawn("ball.usda", (0, 0, -5))
    free.scenario.save("run.json")
    with pytest.raises(StageError, match="is outside"):
        ts.Stream("run.json", root="inside", **SMALL)


def test_templates_within_the_root_and_of_the_catalog_are_read(scene):
    objects = [ts.Object("a", "inside/ball.usda", (0, 0, -5)), ts.Object("b", "Cube", (2, 0, -5))]
    assert names(ts.Stream(ts.Scenario(scene, objects), root="inside", **SMALL)) == ["Ball", "Cube"]


@pytest.mark.parametrize("options", [{"untrusted": True}, {"limits": ts.Limits()}], ids=str)
def test_untrusted_templates_are_opened_in_another_process(scene, tmp_path, monkeypatch, options):
    def refuse(*args, **kwargs):
        raise AssertionError("opened in this process")

    monkeypatch.setattr(template, "open_stage", refuse)
    monkeypatch.setattr(layers, "_dependencies", refuse)
    stream = ts.Stream(ts.Scenario(scene, [ts.Object("a", "ball.usda", (0, 0, -5))]), **options, **SMALL)
    assert names(stream) == ["Ball"]
    export(stream, tmp_path / "out", format="png", frames=range(1))  # its manifest has the digests of the files
    assert set(json.loads((tmp_path / "out" / "tiscene.json").read_text())["file_digests"]) == {
        "scene.usda",
        "ball.usda: ball.usda",
    }

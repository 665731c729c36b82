# SPDX-License-Identifier: Apache-2.0
"""`tiscene import`: files, output and errors."""

from __future__ import annotations

import pytest

from tests.usd.importers.test_furniture_catalog import furniture_catalog
from tests.usd.importers.test_import_template import BOX
from tiscene import catalog
from tiscene.cli import main as cli

__all__ = ["furniture_catalog"]  # a fixture


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "box.obj"
    path.write_text(BOX)
    return path


def test_import_makes_a_template_of_a_model(model, tmp_path, capsys, monkeypatch):
    library = tmp_path / "library"
    arguments = ["import", str(model), "-o", str(library), "--name", "Chair 03", "--label", "chair"]
    assert cli.main(arguments) == 0
    out = capsys.readouterr().out
    assert out.startswith("Chair 03: 2 x 1 x 4 m, 3 triangles\n")
    assert f"export TISCENE_PATH={library}" in out
    monkeypatch.setenv("TISCENE_PATH", str(library))
    assert catalog.find_template("Chair 03") == library / "templates" / "chair_03" / "template.usda"
    assert (
        cli.main(["import", str(model), "--unit", "10", "--license", "mine"]) == 0
    )  # into the first folder of TISCENE_PATH
    out = capsys.readouterr().out
    assert "40 m is an unusual size for an object in a room: is --unit correct?" in out
    assert "TISCENE_PATH" not in out


def test_import_replaces_a_template_only_when_it_is_told_to(model, tmp_path, capsys):
    other = tmp_path / "other" / "box.obj"
    other.parent.mkdir()
    other.write_text(BOX)
    template = tmp_path / "library" / "templates" / "box" / "template.usda"
    assert cli.main(["import", str(model), "-o", str(tmp_path / "library"), "--author", "first"]) == 0
    again = ["import", str(other), "-o", str(tmp_path / "library"), "--author", "second"]
    assert cli.main(again) == 2
    assert "has a template 'Box' already: give another --name, or --overwrite it" in capsys.readouterr().err
    assert "first" in template.read_text()
    assert cli.main([*again, "--overwrite"]) == 0
    assert "second" in template.read_text()


def test_import_of_a_large_usd_model_asks_for_the_unit_of_the_file(tmp_path, capsys):
    model = tmp_path / "hall.usda"
    model.write_text('#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "Hall"\n{\n    double size = 50\n}\n')
    assert cli.main(["import", str(model), "-o", str(tmp_path / "library")]) == 0
    assert "50 m is an unusual size for an object in a room: is its metersPerUnit correct?" in capsys.readouterr().out


def test_import_of_a_catalog_makes_a_template_of_each_model(furniture_catalog, tmp_path, capsys):
    assert cli.main(["import", str(furniture_catalog), "-o", str(tmp_path / "library")]) == 0
    captured = capsys.readouterr()
    assert "2 of 3 models of test.sh3f in" in captured.out
    assert "Wall is left out" in captured.err
    assert (tmp_path / "library" / "templates" / "oak_chair_01" / "template.usda").is_file()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["gone.obj"], "no file 'gone.obj'"),
        (["{catalog}", "--name", "x"], "--name: a catalog defines this for each of its models; leave it out"),
        (["{model}", "--name", "!"], "must have a letter or a digit"),
    ],
)
def test_user_errors_have_status_2_and_a_message(
    arguments, expected, model, furniture_catalog, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words = [word.format(model=model, catalog=furniture_catalog) for word in arguments]
    assert cli.main(["import", *words]) == 2
    assert expected in capsys.readouterr().err

# SPDX-License-Identifier: Apache-2.0
"""Templates are read once, and again when a file of theirs has changed."""

from __future__ import annotations

import os

import pytest

from tests.usd.helpers import write
from tests.usd.read.test_template import CHAIR, DEFAULT
from tiscene.errors import MissingFile, StageWarning
from tiscene.usd.read import kept_templates
from tiscene.usd.read.kept_templates import kept_template
from tiscene.usd.read.template import read_template


@pytest.fixture(autouse=True)
def empty(monkeypatch):
    """Begin without kept templates."""
    monkeypatch.setattr(kept_templates, "_kept", {})


def test_template_is_read_once_for_each_up_axis(tmp_path):
    path = write(tmp_path, CHAIR, more=DEFAULT)
    first = kept_template(path, up_axis="Y")
    assert kept_template(path, up_axis="Y") is first
    assert kept_template(path, up_axis="Z") is not first
    assert first.category == read_template(path, up_axis="Y").category == "chair"


def test_changed_file_that_a_template_refers_to_is_read_again(tmp_path):
    write(tmp_path, CHAIR, more=DEFAULT, name="chair.usda")
    reference = 'def Xform "Other" (prepend references = @chair.usda@) {}\n'
    path = write(tmp_path, reference, more='defaultPrim = "Other"', name="other.usda")
    first = kept_template(path)
    assert kept_template(path) is first
    write(tmp_path, CHAIR.replace("(0, 1, 0)", "(0, 3, 0)"), more=DEFAULT, name="chair.usda")
    again = kept_template(path)
    assert (
        again.description.instances[0].world_from_object[1, 3]
        == 3 * first.description.instances[0].world_from_object[1, 3]
    )


def test_template_that_is_saved_while_it_is_read_is_read_again(tmp_path, monkeypatch):
    path = write(tmp_path, CHAIR, more=DEFAULT)
    read = kept_templates.template_and_report

    def read_and_save(*arguments):
        result = read(*arguments)
        write(tmp_path, CHAIR.replace('["chair"]', '["stool"]'), more=DEFAULT)
        return result

    with monkeypatch.context() as patch:
        patch.setattr(kept_templates, "template_and_report", read_and_save)
        assert kept_template(path).category == "chair"
    assert kept_template(path).category == "stool"


def test_removed_template_is_missing(tmp_path):
    path = write(tmp_path, CHAIR, more=DEFAULT)
    kept_template(path)
    os.remove(path)
    with pytest.raises(MissingFile):
        kept_template(path)


def test_kept_template_warns_each_time_of_what_was_left_out(tmp_path):
    broken = CHAIR.replace('def Cube "Back" {', 'def Mesh "Back" {\n        int[] faceVertexCounts = [3]\n')
    path = write(tmp_path, broken, more=DEFAULT)
    for _ in range(2):
        with pytest.warns(StageWarning, match="Back"):
            kept_template(path)


def test_templates_used_least_recently_are_dropped_at_the_limit(tmp_path, monkeypatch):
    paths = [write(tmp_path, CHAIR, more=DEFAULT, name=f"chair_{number}.usda") for number in range(3)]
    one = kept_template(paths[0])
    monkeypatch.setattr(kept_templates, "MAX_BYTES", 2 * kept_templates._bytes_of(one.description))
    two = kept_template(paths[1])
    assert kept_template(paths[0]) is one
    kept_template(paths[2])
    assert kept_template(paths[0]) is one
    assert kept_template(paths[1]) is not two

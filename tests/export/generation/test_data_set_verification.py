# SPDX-License-Identifier: Apache-2.0
"""A whole data set is verified: whatever is damaged is named with its scenario, and does not hide other damage."""

import json
import shutil

import pytest

from tests.export.generation.test_recipe import RECIPE
from tiscene.cli import main as cli
from tiscene.errors import ArgumentError, ExportError
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.data_set_verification import verify_data_set
from tiscene.export.generation.generator import generate
from tiscene.export.generation.recipe import Recipe
from tiscene.files import lock_folder

COUNT = 4
IMPOSSIBLE = {"scene": "object_view", "ranges": {"depth": [1e-4, 2e-4]}, "weight": 0.5}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set of four scenarios, of which some cannot be drawn."""
    folder = tmp_path_factory.mktemp("made")
    recipe = Recipe.from_json(RECIPE | {"scenes": ["object_view", IMPOSSIBLE]})
    generate(recipe, folder, COUNT)
    return folder


@pytest.fixture
def copied(made, tmp_path):
    """A copy of it, and the folders of its scenarios with frames."""
    shutil.copytree(made, tmp_path / "data")
    data_set = DataSet.load(tmp_path / "data")
    with_frames = [number for number, summary in data_set.summaries() if "error" not in summary]
    assert 2 <= len(with_frames) < COUNT
    return tmp_path / "data", [data_set.scenario_folder(number) for number in with_frames]


def name(folder):
    return f"{folder.parent.name}/{folder.name}"


def test_undisturbed_data_set_is_good(copied, capsys):
    folder, scenarios = copied
    count, seen = len(scenarios), []
    found = verify_data_set(folder, progress=lambda number, frame: seen.append((number, frame)))
    assert found.is_good
    failed = COUNT - count
    assert (found.scenarios, found.failed, found.frames, found.rendered) == (COUNT, failed, 3 * count, 3 * count)
    assert [number for number, frame in seen if frame is None] == list(range(COUNT))
    assert len(seen) == COUNT + 3 * count
    assert cli.main(["verify", str(folder), "--sample", "3"]) == 0
    assert capsys.readouterr().out == (
        f"4 scenarios, {failed} of them with an error and without frames: files of {3 * count} frames are complete; "
        "3 rendered again, same bytes\n"
    )


def test_sample_is_spread_over_all_scenarios(copied):
    folder, scenarios = copied
    seen = []
    assert verify_data_set(folder, sample=2, progress=lambda *which: seen.append(which)).rendered == 2
    assert [which for which in seen if which[1] is not None] == [
        (int(scenarios[0].name), 0),
        (int(scenarios[-1].name), 2),
    ]


def test_all_damage_is_named(copied, capsys):
    folder, scenarios = copied
    first, last = scenarios[0], scenarios[-1]
    (first / "000001.npz").write_bytes(b"damaged")
    (folder / "index.jsonl").unlink()
    shutil.rmtree(last)
    (folder / "train" / "000009").mkdir()
    found = verify_data_set(folder, sample=0)
    assert found.problems == {
        name(first): ("files of 1 frame are missing or damaged: 1",),
        name(last): ("is missing, or its summary.json is damaged; `tiscene generate` makes it",),
        "train/000009": ("is not of the data set, which has 4 scenarios",),
        "index.jsonl": (f"is not that of the scenarios; `tiscene merge {folder}` writes it again",),
        "statistics.json": (f"is not that of the scenarios; `tiscene merge {folder}` writes it again",),
    }
    assert cli.main(["verify", str(folder), "--sample", "0"]) == 2
    told = capsys.readouterr().err
    assert f"  {name(first)}: files of 1 frame are missing or damaged: 1\n" in told


def test_frames_that_render_otherwise_and_files_of_other_scenarios_are_named(copied):
    folder, scenarios = copied
    manifest = json.loads((scenarios[0] / "tiscene.json").read_text())
    manifest["frames"]["2"]["buffers"]["instance"] = "0" * 64
    (scenarios[0] / "tiscene.json").write_text(json.dumps(manifest))
    shutil.copy(scenarios[0] / "scenario.json", scenarios[1])
    summary = json.loads((scenarios[1] / "summary.json").read_text()) | {"digest": ""}
    (scenarios[1] / "summary.json").write_text(json.dumps(summary))
    found = verify_data_set(folder)
    assert found.problems[name(scenarios[0])] == ("1 of 3 frames rendered otherwise (instance): 2",)
    assert found.problems[name(scenarios[1])] == (
        "its summary.json is not that of its frames",
        "its scenario.json is not that of its frames",
    )


def test_scenario_without_a_manifest_or_in_use_is_named(copied):
    folder, scenarios = copied
    (scenarios[0] / "tiscene.json").unlink()
    with lock_folder(scenarios[1]):
        found = verify_data_set(folder, sample=0)
    assert "is not an export: it has no tiscene.json" in found.problems[name(scenarios[0])][0]
    assert "writes into it" in found.problems[name(scenarios[1])][0]


def test_invalid_arguments_are_refused(made, tmp_path):
    with pytest.raises(ArgumentError, match="sample=-1: must be 0 or more"):
        verify_data_set(made, sample=-1)
    with pytest.raises(ExportError, match=r"has no data set: it has no dataset\.json"):
        verify_data_set(tmp_path)

# SPDX-License-Identifier: Apache-2.0
"""Data sets: complete, repeatable, continued and extended, made in shards with the same bytes."""

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.benchmarks.scenarios import measure
from tests.export.folders import contents
from tests.export.generation.test_recipe import RECIPE
from tiscene import catalog
from tiscene.cli import main as cli
from tiscene.errors import ArgumentError, ExportError, StageWarning
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import finish, generate, write_scenario
from tiscene.export.generation.recipe import Recipe
from tiscene.export.manifest import Manifest
from tiscene.export.verification import verify
from tiscene.scenario.scenario import Scenario

COUNT = 4


@pytest.fixture(scope="module")
def recipe():
    return Recipe.from_json(RECIPE | {"scenes": ["object_view"]})


@pytest.fixture(scope="module")
def whole(recipe, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    generate(recipe, folder, COUNT)
    return folder


def test_data_set_has_scenarios_index_statistics_and_sheet(recipe, whole):
    rows = [json.loads(line) for line in (whole / "index.jsonl").read_text().splitlines()]
    assert [row["number"] for row in rows] == list(range(COUNT))
    for row in rows:
        folder = whole / row["split"] / f"{row['number']:06d}"
        assert row["split"] == recipe.split(row["number"])
        assert list(Manifest.load(folder).frames) == [0, 1, 2]
        assert Scenario.load(folder / "scenario.json") == recipe.scenario(row["number"])
        assert row["frames"] == 3
        assert row["objects"]
        assert row["difficulty"]["instances"] >= 0
    statistics = json.loads((whole / "statistics.json").read_text())
    assert (statistics["scenarios"], statistics["frames"], statistics["failed"]) == (COUNT, 3 * COUNT, 0)
    assert sum(statistics["scenarios_by_split"].values()) == COUNT
    assert sum(statistics["visible_objects_by_category"].values()) == sum(
        statistics["visible_objects_by_size"].values()
    )
    sheet = np.asarray(Image.open(whole / "contact_sheet.png"))
    assert sheet.shape[1] >= 160
    assert sheet.std() > 5


def test_visible_objects_are_counted_from_the_buffers(whole):
    for row in map(json.loads, (whole / "index.jsonl").read_text().splitlines()):
        folder = whole / row["split"] / f"{row['number']:06d}"
        count = 0
        for index in range(3):
            with np.load(folder / f"{index:06d}.npz") as arrays:
                count += len(set(np.unique(arrays["instance"])) - {0})
        assert sum(row["visible"].values()) == count


def test_interrupted_data_set_is_continued_and_extended_to_the_same_bytes(recipe, whole, tmp_path):
    def interrupt(number, frame):
        if (number, frame) == (2, 1):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(recipe, tmp_path, 3, progress=interrupt)
    done = DataSet.load(tmp_path)
    assert done.missing() == [2]
    rendered = set()
    generate(recipe, tmp_path, 3, progress=lambda number, frame: rendered.add(number) if frame is not None else None)
    assert rendered == {2}
    generate(recipe, tmp_path, COUNT)
    assert contents(tmp_path) == contents(whole)


def test_second_process_does_not_delete_what_the_first_one_writes(recipe, whole, tmp_path):
    def start_another(number, frame):
        if (number, frame) == (0, 1):
            with pytest.raises(ExportError, match=f"process {os.getpid()} .* writes into it"):
                generate(recipe, tmp_path, COUNT)

    generate(recipe, tmp_path, COUNT, progress=start_another)
    assert contents(tmp_path) == contents(whole)


@pytest.mark.slow
def test_shards_give_the_bytes_of_one_process(recipe, whole, tmp_path, capsys):
    for shard in (1, 0):
        generate(recipe, tmp_path, COUNT, shard=(shard, 3))
    with pytest.raises(ExportError, match="2 scenarios are missing of 4, the first is 2: generate the shards"):
        finish(tmp_path)
    generate(recipe, tmp_path, COUNT, shard=(2, 3))
    assert cli.main(["merge", str(tmp_path)]) == 0
    assert contents(tmp_path) == contents(whole)


@pytest.mark.slow
def test_scenario_has_its_camera_and_size_whichever_is_rendered_before(tmp_path):
    scene = catalog.find_scene("object_view").as_posix()
    for name, size in (("wide", "(32, 16)"), ("tall", "(16, 32)")):
        head = f'(\nsubLayers = [@{scene}@]\ndefaultPrim = "ObjectView"\nrenderSettingsPrimPath = "/Render/Settings"\n)'
        change = f'over "Render"\n{{\nover "Settings"\n{{\nuniform int2 resolution = {size}\n}}\n}}'
        (tmp_path / f"{name}.usda").write_text(f"#usda 1.0\n{head}\n{change}\n")
    settings = {"buffers": ["instance"], "camera": ["Agent", "Main"]}
    scenes = [str(tmp_path / "wide.usda"), str(tmp_path / "tall.usda")]
    recipe = Recipe.from_json(RECIPE | {"scenes": scenes, "settings": settings, "frames": 1})
    generate(recipe, tmp_path / "whole", COUNT)
    for number in range(COUNT):
        generate(recipe, tmp_path / "parts", COUNT, shard=(number, COUNT))
    finish(tmp_path / "parts")
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
    sizes = set()
    for path in (tmp_path / "whole").rglob("0*.npz"):
        with np.load(path) as arrays:
            sizes.add((path.parent.name, arrays["instance"].shape))
    assert sizes == {(camera, shape) for camera in ("Agent", "Main") for shape in ((16, 32), (32, 16))}


def test_folder_of_another_recipe_is_refused(recipe, whole):
    other = Recipe.from_json(recipe.to_json() | {"seed": 6})
    with pytest.raises(ExportError, match=r"data set of another recipe:\s+seed: 5 in the folder, 6 requested"):
        generate(other, whole, COUNT)


def test_smaller_count_is_refused_where_the_index_would_lose_scenarios(recipe, whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    with pytest.raises(
        ExportError, match=r"has 2 scenarios beyond the first 2, such as .*000003'.*pass count=4 \(-n 4\)"
    ):
        generate(recipe, tmp_path, 2)
    assert contents(tmp_path) == contents(whole)
    for number in (2, 3):
        shutil.rmtree(DataSet.load(tmp_path).scenario_folder(number))
    assert generate(recipe, tmp_path, 2).missing() == []


def test_folders_of_others_where_scenarios_go_are_not_emptied(recipe, tmp_path):
    mine = DataSet(tmp_path, recipe, 1).scenario_folder(0) / "rgb" / "000000.png"
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"mine")
    with pytest.raises(ExportError, match=r"000000' is there and is not of a data set"):
        generate(recipe, tmp_path, 1)
    assert contents(tmp_path) == {str(mine.relative_to(tmp_path)): b"mine"}


def test_samples_of_another_recipe_are_not_mixed_with_those_of_this_one(recipe, tmp_path):
    first = write_scenario(recipe, tmp_path, 0)
    write_scenario(recipe, tmp_path, 1)
    before = contents(tmp_path)
    other_seed = Recipe.from_json(recipe.to_json() | {"seed": 6})
    other_split = Recipe.from_json(recipe.to_json() | {"splits": {"all": 1}})
    for other in (other_seed, other_split):
        with pytest.raises(ExportError, match=r"000000\.json' is there and is not scenario 0 of this recipe"):
            write_scenario(other, tmp_path, 0)
    assert contents(tmp_path) == before
    assert write_scenario(recipe, tmp_path, 0) == first
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("changed", "difference"),
    [({"seed": 6}, "scenario.objects: "), ({"settings": {**RECIPE["settings"], "width": 28}}, "settings.width: ")],
)
def test_folder_of_another_recipe_is_refused_without_its_description(recipe, whole, tmp_path, changed, difference):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    (tmp_path / "dataset.json").unlink()
    before = contents(tmp_path)
    with pytest.raises(ExportError, match=f"data set of another recipe:[^!]*{difference}"):
        generate(Recipe.from_json(recipe.to_json() | changed), tmp_path, COUNT + 1)
    assert contents(tmp_path) == before


def test_recipe_with_a_wrong_setting_can_be_corrected_in_its_folder(recipe, tmp_path):
    wrong = Recipe.from_json(recipe.to_json() | {"settings": {"width": 24, "height": 18, "quality": "fasst"}})
    with pytest.raises(ArgumentError, match="quality='fasst'"):
        generate(wrong, tmp_path, 1)
    assert generate(recipe, tmp_path, 1).missing() == []


@pytest.mark.parametrize("command", ["generate", "sample"])
def test_folder_that_cannot_be_written_is_named(recipe, tmp_path, capsys, command):
    (tmp_path / "recipe.json").write_text(json.dumps(recipe.to_json()))
    (tmp_path / "file").write_text("")
    assert cli.main([command, str(tmp_path / "recipe.json"), "-n", "1", "-o", str(tmp_path / "file")]) == 2
    assert f"tiscene: cannot write '{tmp_path / 'file'}" in capsys.readouterr().err
    assert cli.main(["verify", str(tmp_path / "file")]) == 2
    assert "is not an export: it has no tiscene.json" in capsys.readouterr().err


def test_damaged_data_set_says_what_to_do_and_that_helps(recipe, whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(ExportError, match="delete it, and generate again with the same recipe"):
        generate(recipe, tmp_path, COUNT)
    (tmp_path / "dataset.json").unlink()
    folder = DataSet(tmp_path, recipe, COUNT).scenario_folder(1)
    (folder / "thumbnail.png").write_bytes(b"damaged")
    with pytest.raises(ExportError, match=rf"thumbnail\.png' is missing or damaged: delete '{folder}', and generate"):
        generate(recipe, tmp_path, COUNT)
    shutil.rmtree(folder)
    generate(recipe, tmp_path, COUNT)
    assert contents(tmp_path) == contents(whole)


@pytest.mark.parametrize("damage", ["", "{", "null", "[]", "{}", '{"number": 0, "split": "train"}'])
def test_scenario_with_a_damaged_summary_is_made_again(recipe, whole, tmp_path, damage):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    data_set = DataSet.load(tmp_path)
    (data_set.scenario_folder(0) / "summary.json").write_text(damage)
    assert data_set.missing() == [0]
    generate(recipe, tmp_path, COUNT)
    assert contents(tmp_path) == contents(whole)


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ("objct_view", "no scene 'objct_view'"),
        ("gone.usda", "gone.usda"),
        ({"scene": "object_view", "cameras": ["Nope"]}, "Nope"),
        ({"scene": "object_view", "ranges": {"templates": ["Cubee"]}}, "no template 'Cubee'"),
    ],
)
def test_scene_camera_or_template_that_is_not_there_does_not_lose_the_others(whole, tmp_path, capsys, wrong, error):
    mixed = Recipe.from_json(RECIPE | {"scenes": ["object_view", wrong]})
    rows = [summary for _, summary in generate(mixed, tmp_path, COUNT).summaries()]
    failed = [row for row in rows if "error" in row]
    assert 0 < len(failed) < COUNT
    assert all(error in row["error"] and "cannot write" not in row["error"] for row in failed)
    assert len((tmp_path / "index.jsonl").read_text().splitlines()) == COUNT
    expected = {row["number"]: row["digest"] for _, row in DataSet.load(whole).summaries()}
    assert all(row["digest"] == expected[row["number"]] for row in rows if "error" not in row)
    file = tmp_path / "recipe.json"
    file.write_text(json.dumps(mixed.to_json()))
    if "Nope" not in error:  # a camera is known once its stage is read
        (message,) = mixed.unknown_names()
        assert error in message
    assert cli.main(["sample", str(file), "-n", str(COUNT), "-o", str(tmp_path / "samples")]) == 3
    shown = capsys.readouterr()
    assert len(shown.out.split()) == COUNT - len(failed)
    assert f"{len(failed)} of {COUNT} scenarios cannot be drawn, the first is {failed[0]['number']}: " in shown.err


def test_scenario_whose_scene_was_not_there_is_made_when_it_is_and_of_no_changed_one(tmp_path):
    stage = tmp_path / "later.usda"
    later = Recipe.from_json(RECIPE | {"scenes": [str(stage)]})
    summaries = generate(later, tmp_path / "data", COUNT).summaries()
    assert all("later.usda" in summary["error"] for _, summary in summaries)
    shutil.copy(catalog.find_scene("object_view"), stage)
    generate(later, tmp_path / "data", COUNT)
    generate(later, tmp_path / "at once", COUNT)
    assert contents(tmp_path / "data") == contents(tmp_path / "at once")
    assert not any("error" in summary for _, summary in DataSet.load(tmp_path / "data").summaries())
    text, before = stage.read_text(), contents(tmp_path / "data")
    stage.write_text(text + "\n# changed\n")
    changed = r"later\.usda' has changed since scenarios in .* were made of it:\n  later\.usda: .*\nRestore it"
    with pytest.raises(ExportError, match=changed):
        generate(later, tmp_path / "data", COUNT + 1)
    stage.write_text(text)
    generate(later, tmp_path / "data", COUNT)
    assert contents(tmp_path / "data") == before


def test_categories_of_several_templates_have_the_same_ids_if_selected_and_are_warned_of_else(tmp_path, recwarn):
    names = ("robot", "drone")
    for name in names:
        head = '#usda 1.0\n(\ndefaultPrim = "A"\nmetersPerUnit = 1\n)\n'
        label = f'double size = 0.3\ntoken[] semantics:labels:class = ["{name}"]'
        cube = f'def Cube "A" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])\n{{\n{label}\n}}\n'
        (tmp_path / f"{name}.usda").write_text(head + cube)
    ranges = RECIPE["ranges"] | {"templates": [str(tmp_path / f"{name}.usda") for name in names]}
    own = Recipe.from_json(RECIPE | {"scenes": ["object_view"], "ranges": ranges, "frames": 1})
    generate(own, tmp_path / "any", 1)
    with pytest.warns(StageWarning, match="the category 1000 is '.*' in some scenarios and '.*' in others: name"):
        generate(own, tmp_path / "any", COUNT)
    recwarn.clear()
    selected = Recipe.from_json(own.to_json() | {"settings": RECIPE["settings"] | {"categories": list(names)}})
    data_set = generate(selected, tmp_path / "selected", COUNT)
    manifests = [Manifest.load(data_set.scenario_folder(number)) for number in range(COUNT)]
    assert {tuple(manifest.categories.items()) for manifest in manifests} == {((0, ""), (1, "robot"), (2, "drone"))}
    assert not [each for each in recwarn if "the category" in str(each.message)]


def test_split_with_the_name_of_a_file_of_the_data_set_is_refused(tmp_path):
    for name in ("dataset.json", "Index.jsonl", "readme.md"):
        with pytest.raises(ArgumentError, match=f"splits: '{name}' is a file of the data set"):
            generate(Recipe.from_json(RECIPE | {"splits": {"train": 1, name: 1}}), tmp_path, 1)
    assert contents(tmp_path) == {}


@pytest.mark.slow
def test_scenario_that_cannot_be_drawn_does_not_lose_the_others(tmp_path, capsys):
    impossible = {"scene": "object_view", "ranges": {"depth": [1e-4, 2e-4]}}
    recipe = Recipe.from_json(RECIPE | {"scenes": ["object_view", impossible]})
    (tmp_path / "recipe.json").write_text(json.dumps(recipe.to_json()))
    assert cli.main(["generate", str(tmp_path / "recipe.json"), "-n", "4", "-o", str(tmp_path)]) == 3
    rows = [json.loads(line) for line in (tmp_path / "index.jsonl").read_text().splitlines()]
    failed = [row for row in rows if "error" in row]
    assert 0 < len(failed) < 4
    note = f"Errors in {len(failed)} of 4 scenarios, the first in {failed[0]['number']}: "
    assert note + failed[0]["error"] in capsys.readouterr().err
    assert json.loads((tmp_path / "statistics.json").read_text())["failed"] == len(failed)


def test_commands_write_scenarios_and_data_sets(recipe, tmp_path, capsys):
    file = tmp_path / "recipe.json"
    file.write_text(json.dumps(recipe.to_json()))
    assert cli.main(["sample", str(file), "-n", "2", "-o", str(tmp_path / "scenarios")]) == 0
    printed = capsys.readouterr().out.split()
    assert [Scenario.load(path) for path in printed] == [recipe.scenario(0), recipe.scenario(1)]
    assert write_scenario(recipe, tmp_path / "again", 0).read_bytes() == Path(printed[0]).read_bytes()
    assert cli.main(["generate", str(file), "-n", "1", "-o", str(tmp_path / "data")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'data'}\n"
    assert (tmp_path / "data" / "index.jsonl").is_file()
    assert cli.main(["verify", str(tmp_path / "data"), "--sample", "2"]) == 0
    assert capsys.readouterr().out == "1 scenario: files of 3 frames are complete; 2 rendered again, same bytes\n"
    with pytest.raises(ExportError, match="a data set is verified by `verify_data_set`"):
        verify(tmp_path / "data")


def test_recipe_of_which_no_scenario_can_be_drawn_is_an_error_of_the_command(tmp_path, capsys):
    file = tmp_path / "recipe.json"
    file.write_text(json.dumps(Recipe.from_json(RECIPE | {"scenes": ["objct_view"]}).to_json()))
    assert cli.main(["sample", str(file), "-n", "2", "-o", str(tmp_path / "samples")]) != 0
    assert "no scene 'objct_view'. Did you mean 'object_view'?" in capsys.readouterr().err
    assert not (tmp_path / "samples").exists()


@pytest.mark.parametrize("workers", [(), ("--workers", "2")])
def test_data_set_whose_scenarios_have_errors_has_an_exit_status_of_its_own(tmp_path, capsys, workers):
    file, data = tmp_path / "recipe.json", tmp_path / "data"
    file.write_text(json.dumps(Recipe.from_json(RECIPE | {"scenes": [str(tmp_path / "later.usda")]}).to_json()))
    assert cli.main(["generate", str(file), "-n", "2", "-o", str(data), *workers]) == 3
    shown = capsys.readouterr()
    assert shown.out == f"{data}\n"
    assert re.search(r"Errors in 2 of 2 scenarios, the first in 0: .*later\.usda", shown.err)
    assert json.loads((data / "statistics.json").read_text())["failed"] == 2
    assert cli.main(["generate", str(file), "-n", "2", "-o", str(data), "--shard", "1/2"]) == 3
    assert "Errors in 1 of 1 scenario, the first in 1: " in capsys.readouterr().err
    assert cli.main(["merge", str(data)]) == 3
    assert "Errors in 2 of 2 scenarios" in capsys.readouterr().err
    shutil.copy(catalog.find_scene("object_view"), tmp_path / "later.usda")
    assert cli.main(["generate", str(file), "-n", "2", "-o", str(data), "--shard", "1/2"]) == 0
    assert cli.main(["merge", str(data)]) == 3
    assert cli.main(["generate", str(file), "-n", "2", "-o", str(data)]) == 0
    assert cli.main(["merge", str(data)]) == 0


@pytest.mark.parametrize("number", ["0", "-2", "1.5"])
def test_counts_below_one_are_a_usage_error(number, capsys):
    for arguments in (["render", "object_view", "--workers", number], ["sample", "recipe.json", "-n", number]):
        with pytest.raises(SystemExit):
            cli.main([*arguments, "-o", "out"])
        assert f"'{number}' is not a whole number from 1 on" in capsys.readouterr().err


@pytest.mark.slow
def test_memory_and_time_are_flat_over_hundreds_of_scenarios_of_three_scenes(tmp_path):
    measured = measure(tmp_path, 300)
    print(f"growth {measured.growth():.3f}, drift {measured.drift():.3f}, overhead {measured.overhead():.2f}")
    assert measured.growth() < 1.1
    assert measured.drift() < 1.1

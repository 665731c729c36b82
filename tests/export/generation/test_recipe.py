# SPDX-License-Identifier: Apache-2.0
"""Recipes: mistakes name their place; a scenario depends on the recipe and its number alone."""

import json
from collections import Counter

import pytest

from tiscene import catalog
from tiscene.errors import ArgumentError, MissingFile, ScenarioError
from tiscene.export.generation.recipe import Recipe
from tiscene.stream.stream import Stream

RECIPE = {
    "scenes": ["object_view", {"scene": "solid_benchmark", "weight": 0.5}],
    "ranges": {"objects": 1, "templates": ["Cube", "Sphere"], "depth": [1.5, 3.0]},
    "frames": 3,
    "settings": {"width": 24, "height": 18, "buffers": ["instance", "forward_flow"]},
    "format": "npz",
    "splits": {"train": 0.7, "test": 0.3},
    "seed": 5,
}


def test_recipe_survives_json():
    recipe = Recipe.from_json(RECIPE)
    assert Recipe.from_json(recipe.to_json()) == recipe
    assert [choice.scene for choice in recipe.scenes] == ["object_view", "solid_benchmark"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene": ["a"]}, "recipe: no field 'scene'; did you mean 'scenes'?"),
        ({"scenes": []}, "must be a list with at least one scene"),
        ({"scenes": {"object_view": 9}}, 'must be a list with .* such as .*"scene": "room_02", "weight": 2'),
        ({"scenes": 5}, "must be a list with at least one scene"),
        ({"scenes": [{"wight": 2}]}, r"scenes\[0\]: no field 'wight'; did you mean 'weight'?"),
        ({"scenes": [{"weight": 2}]}, r'scenes\[0\]: needs "scene"'),
        ({"format": "jpg"}, "format='jpg': must be one of png"),
        (
            {"format": "coco"},
            "recipe: settings: format='coco' requires the buffer 'rgb' and does not write 'forward_flow",
        ),
        (
            {"format": "lerobot", "settings": {"buffers": ["rgb", "depth"]}},
            "recipe: settings: format='lerobot' does not write 'depth'",
        ),
        ({"settings": {"buffers": "depth"}}, "recipe: settings: buffers='depth': must be a sequence of names"),
        ({"settings": {"buffers": ["dept"]}}, "recipe: settings: no buffer 'dept'. Did you mean 'depth'?"),
        ({"frames": 0}, "frames=0: must be at least 1"),
        ({"splits": {"train": 0}}, "must have a sum above 0"),
        ({"splits": {}}, "must be shares by name"),
        ({"splits": ["train"]}, r"recipe: splits: must be an object, got \['train'\]"),
        ({"splits": {"../other": 1}}, "splits: '../other' is no name of a folder"),
        ({"splits": {"": 1}}, "splits: '' is no name of a folder"),
        ({"splits": {"a" * 256: 1}}, "splits: 'aa*' is longer than a name of a folder: 255 bytes"),
        ({"splits": {"train": "all"}}, "splits: train='all': must be a number"),
        ({"seed": -1}, "recipe: seed=-1: must be at least 0"),
        ({"ranges": [1]}, r"recipe: ranges: must be an object, got \[1\]"),
        ({"ranges": {"objects": [3, 1]}}, r"recipe: ranges: objects=\[3, 1\]: must be 0 or more, low before high"),
        (
            {"scenes": ["room_02", {"scene": "room_02", "ranges": {"life": 4}}]},
            r"scenes\[1\]: ranges: life=\(4, 4\) is longer than the stream: frames=3",
        ),
        ({"ranges": {"object": 1}}, "recipe: ranges: no field 'object'; did you mean 'objects'?"),
        ({"settings": [1]}, r"recipe: settings: must be an object, got \[1\]"),
        ({"settings": {"widht": 24}}, "recipe: settings: no field 'widht'; did you mean 'width'?"),
        ({"settings": {"frames": 24}}, "recipe: settings: no field 'frames'"),
        (
            {"scenes": [{"scene": "room_02", "cameras": ["Main"]}], "settings": {"camera": "Sofa"}},
            r"scenes\[0\]: cameras: settings.camera='Sofa' is that of every scenario",
        ),
        ({"settings": {"camera": 1}}, "settings: camera=1: must be a name or a list of names"),
        ({"scenes": [{"scene": "room_02", "weight": "2"}]}, r"scenes\[0\]: weight='2': must be a number"),
        ({"scenes": [{"scene": "room_02", "weight": -1}]}, r"scenes\[0\]: weight=-1: must not be negative"),
        ({"scenes": [{"scene": "room_02", "cameras": "Main"}]}, r"scenes\[0\]: cameras: must be a list of names"),
        (
            {"scenes": [{"scene": "room_02", "variants": {"/R{a}": "b"}}]},
            r"scenes\[0\]: /R{a}: must be a list of names",
        ),
        ({"scenes": [{"scene": "room_02", "ranges": {"speeds": 1}}]}, r"scenes\[0\]: ranges: no field 'speeds'"),
    ],
)
def test_mistakes_name_their_place(tmp_path, change, message):
    (tmp_path / "recipe.json").write_text(json.dumps(RECIPE | change))
    with pytest.raises(ArgumentError, match=message) as caught:
        Recipe.load(tmp_path / "recipe.json")
    assert str(tmp_path / "recipe.json") in str(caught.value)


def test_file_that_is_no_recipe_raises(tmp_path):
    with pytest.raises(MissingFile, match="no file"):
        Recipe.load(tmp_path / "gone.json")
    broken = tmp_path / "broken.json"
    for text, message in (("{", "line 1, column 2: not JSON"), ('{"frames": 1, "frames": 2}', "'frames' stands twice")):
        broken.write_text(text)
        with pytest.raises(ScenarioError, match=f"broken.json: .*{message}"):
            Recipe.load(broken)


def test_splits_have_their_shares_and_do_not_change_with_other_scenes():
    recipe = Recipe.from_json(RECIPE)
    splits = [recipe.split(number) for number in range(1000)]
    assert Counter(splits)["train"] == pytest.approx(700, abs=60)
    assert splits == [Recipe.from_json(RECIPE | {"scenes": ["room_02"]}).split(number) for number in range(1000)]


def test_scenario_depends_on_its_number_and_the_recipe_alone():
    recipe = Recipe.from_json(RECIPE)
    scenarios = [recipe.scenario(number) for number in range(4)]
    assert [Recipe.from_json(RECIPE).scenario(number) for number in (3, 1)] == [scenarios[3], scenarios[1]]
    assert len({str(each.to_json()) for each in scenarios}) == 4
    assert {each.template for scenario in scenarios for each in scenario.objects} <= {"Cube", "Sphere"}


def test_cameras_and_variants_of_the_settings_are_those_of_every_scenario():
    settings = RECIPE["settings"] | {"camera": ["Left", "Right"], "variants": {"/SolidBenchmark{lighting}": "night"}}
    recipe = Recipe.from_json(RECIPE | {"scenes": ["solid_benchmark"], "settings": settings})
    assert {(each.cameras, *each.variants.items()) for each in map(recipe.scenario, range(3))} == {
        (("Left", "Right"), ("/SolidBenchmark{lighting}", "night"))
    }
    assert not {"camera", "variants"} & recipe.stream_settings().keys()


def test_ranges_that_nothing_fits_are_reported_with_the_number():
    recipe = Recipe.from_json(
        RECIPE | {"scenes": ["object_view"], "ranges": {"templates": ["Cube"], "depth": [1e-4, 2e-4]}}
    )
    with pytest.raises(ScenarioError, match=r"scenario 7 in 'object_view': .* fits nowhere .* \(8 seeds were tried\)"):
        recipe.scenario(7)


@pytest.mark.parametrize(
    ("size", "resolution", "aspect"),
    [
        ({}, "", 4 / 3),
        ({}, "(320, 160)", 2.0),
        ({"width": 64}, "(320, 160)", 2.0),
        ({"height": 64}, "(320, 160)", 2.0),
        ({"width": 384}, "", 2.0),
        ({"width": 64, "height": 64}, "(320, 160)", 1.0),
    ],
)
def test_scenarios_are_drawn_for_the_images_of_the_stream(size, resolution, aspect, tmp_path):
    """Without both of width and height they were drawn for 4:3."""
    head = f'subLayers = [@{catalog.find_scene("object_view").as_posix()}@]\ndefaultPrim = "ObjectView"'
    settings = f'over "Render"\n{{\nover "Settings"\n{{\nuniform int2 resolution = {resolution}\n}}\n}}'
    render = '\nrenderSettingsPrimPath = "/Render/Settings"' if resolution else ""
    (tmp_path / "scene.usda").write_text(f"#usda 1.0\n(\n{head}{render}\n)\n{settings if resolution else ''}\n")
    given = {"buffers": ["instance", "forward_flow"], **size}
    recipe = Recipe.from_json(RECIPE | {"scenes": [str(tmp_path / "scene.usda")], "settings": given})
    with Stream(recipe.scenario(0), **given) as stream:
        assert stream.width / stream.height == pytest.approx(aspect)
    chosen = Recipe.from_json(recipe.to_json() | {"ranges": {**RECIPE["ranges"], "aspect": aspect}})
    assert recipe.scenario(0) == chosen.scenario(0)
    other = Recipe.from_json(recipe.to_json() | {"ranges": {**RECIPE["ranges"], "aspect": 0.3}})
    assert recipe.scenario(0) != other.scenario(0)


def test_format_that_requires_buffers_has_a_stream_with_these_alone_by_default():
    recipe = Recipe.from_json({"scenes": ["object_view"], "format": "coco"})
    assert recipe.stream_settings() == {"buffers": ("rgb", "instance")}
    assert Recipe.from_json({"scenes": ["object_view"]}).stream_settings() == {}

# SPDX-License-Identifier: Apache-2.0
"""Recipes: mistakes name their place; a scenario depends on the recipe and its number alone."""

import json
from collections import Counter

import pytest

from tiscene.errors import ArgumentError, MissingFile, ScenarioError
from tiscene.export.generation.recipe import Recipe

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
        ({"scenes": [{"wight": 2}]}, r"scenes\[0\]: no field 'wight'; did you mean 'weight'?"),
        ({"scenes": [{"weight": 2}]}, r'scenes\[0\]: needs "scene"'),
        ({"format": "jpg"}, "format='jpg': must be one of png"),
        ({"format": "coco"}, "format 'coco' requires the buffer 'rgb'"),
        ({"frames": 0}, "frames=0 must be a whole number from 1 on"),
        ({"splits": {"train": 0}}, "must have a sum above 0"),
        ({"splits": {}}, "must be shares by name"),
    ],
)
def test_mistakes_name_their_place(tmp_path, change, message):
    (tmp_path / "recipe.json").write_text(json.dumps(RECIPE | change))
    with pytest.raises(ArgumentError, match=message) as caught:
        Recipe.load(tmp_path / "recipe.json")
    assert str(tmp_path / "recipe.json") in str(caught.value)


def test_file_that_is_no_recipe_raises(tmp_path):
    with pytest.raises(MissingFile, match="no recipe"):
        Recipe.load(tmp_path / "gone.json")
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(ArgumentError, match="not a JSON file"):
        Recipe.load(tmp_path / "broken.json")


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


def test_ranges_that_nothing_fits_are_reported_with_the_number():
    recipe = Recipe.from_json(
        RECIPE | {"scenes": ["object_view"], "ranges": {"templates": ["Cube"], "depth": [1e-4, 2e-4]}}
    )
    with pytest.raises(ScenarioError, match=r"scenario 7 in 'object_view': .* fits nowhere .* \(8 seeds were tried\)"):
        recipe.scenario(7)

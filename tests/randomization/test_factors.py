# SPDX-License-Identifier: Apache-2.0
"""Factors of variation: each changes its own aspect of a scenario and nothing else, repeatably."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tiscene.errors import ArgumentError, ScenarioError, TemplateNotFound, UnknownName
from tiscene.randomization.factors import FACTORS
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.lens_keyframes import LensKeyframes


@pytest.mark.parametrize("factor", FACTORS)
def test_factor_is_repeatable_and_in_files(drawn, room_of_boxes, factor, tmp_path):
    drawn = Scenario(room_of_boxes) if factor == "furniture" else drawn
    value = {"rooms": "object_view", "clutter": 2}.get(factor)
    made = [drawn.with_factor(factor, value, seed=seed) for seed in (1, 1, 2)]
    assert made[0] == made[1] != drawn
    assert made[0] != made[2]
    assert Scenario.from_json(made[0].to_json()) == made[0]
    made[0].save(tmp_path / "run.usda")
    assert Scenario.load(tmp_path / "run.usda") == made[0]


CHANGES = {
    "categories": {"objects"},
    "clutter": {"objects"},
    "furniture": {"overrides", "variants"},
    "illumination": {"overrides", "variants", "exposure_compensation"},
    "instances": {"objects"},
    "materials": {"overrides"},
    "occlusion": {"objects"},
    "rooms": {"scene", "objects", "camera", "variants", "overrides"},
    "speed": {"objects"},
    "views": {"overrides", "camera"},
}


@pytest.mark.parametrize("factor", FACTORS)
def test_factor_changes_nothing_else(drawn, factor):
    other = drawn.with_factor(factor, {"rooms": "object_view", "clutter": 2}.get(factor), seed=4)
    changed = {name for name in vars(drawn) if getattr(other, name) != getattr(drawn, name)}
    assert changed <= CHANGES[factor]
    ids = [each.id for each in other.objects if not each.id.startswith("distractor_")]
    assert ids == [each.id for each in drawn.objects]
    if factor not in ("occlusion", "rooms", "speed"):
        assert [each.dynamic for each in other.objects][:2] == [each.dynamic for each in drawn.objects]


def test_drawn_lens_of_a_view_does_not_vary(drawn):
    lens = LensKeyframes((0.0, 2.0), vertical_fov=(1.0, 0.2), focus_distance=(1.0, 3.0))
    zooming = replace(drawn, camera=Camera(lens=lens))
    made = zooming.with_factor("views", {"zoom": 2.0}, seed=1).camera
    assert made.at(1.5).vertical_fov == made.vertical_fov
    assert math.tan(0.5 * made.vertical_fov) == pytest.approx(0.5 * math.tan(0.5 * 1.0), rel=1e-3)
    assert made.at(1.5).focus_distance == 2.5


def test_order_of_factors_does_not_matter(drawn):
    factors = ("materials", "views", "illumination", "speed")
    made = []
    for order in (factors, factors[::-1]):
        scenario = drawn
        for factor in order:
            scenario = scenario.with_factor(factor, {"lighting": ()} if factor == "illumination" else None, seed=5)
        made.append(scenario)
    assert made[0] == made[1]


def test_factors_of_sample_leave_its_objects_as_they_were(drawn):
    ranges = {"seed": 3, "objects": 2, "templates": ("Cup 01", "Chair 02"), "scale": 0.5}
    varied = Scenario.sample(
        "solid_benchmark", **ranges, clutter=2, views=True, materials=0.5, illumination={"strength": (0.5, 2)}
    )
    assert varied.objects[:2] == drawn.objects
    assert len(varied.objects) == 4
    kinds = {type(each) for each in varied.overrides}
    assert kinds == {LightOverride, MaterialOverride, CameraOverride}
    assert Scenario.sample("solid_benchmark", **ranges, clutter=False, materials=None) == drawn


@pytest.mark.parametrize(
    ("factor", "value", "error", "message"),
    [
        ("ilumination", None, UnknownName, "no factor 'ilumination'. Did you mean 'illumination'"),
        ("illumination", "noon", ScenarioError, "has no lighting 'noon'; there are day, evening, night"),
        ("illumination", {"strenth": 1}, ArgumentError, "illumination: no such range 'strenth'; there are lighting, "),
        ("illumination", {"color": 2}, ArgumentError, r"illumination: color=2: must lie within 0\.\.1"),
        ("materials", "red", ArgumentError, "materials='red': must be True, or ranges by name: share, color"),
        ("speed", 0, ArgumentError, "speed=0"),
        ("clutter", {"count": 1.5}, ArgumentError, "whole numbers"),
        ("clutter", {"depth": 1e300}, ArgumentError, "clutter: depth=1e"),
        ("clutter", "many", ArgumentError, "clutter='many'"),
        ("clutter", {"count": 1, "templates": ("Nothing 01",)}, TemplateNotFound, "Nothing 01"),
        ("categories", ("unicorn",), ArgumentError, "no template has the category 'unicorn'"),
        ("occlusion", 1.5, ArgumentError, "occlusion=1.5"),
        ("views", {"zoom": 0}, ArgumentError, "views: zoom=0"),
    ],
)
def test_wrong_values_of_factors_raise(drawn, factor, value, error, message):
    with pytest.raises(error, match=message):
        drawn.with_factor(factor, value)
    with pytest.raises(ArgumentError, match="seed=-1"):
        drawn.with_factor("speed", seed=-1)

# SPDX-License-Identifier: Apache-2.0
"""Values that differ between variants of a room are converted in each."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd

from tests.usd.joining.studio import ROOM, stage_of, write_cellar
from tiscene.errors import StageWarning
from tiscene.usd import RoomPlacement, join

NESTED = """
def Xform "Room" (
    prepend variantSets = ["mood", "size"]
    variants = {
        string mood = "calm"
        string size = "small"
    }
) {
    variantSet "mood" = {
        "calm" {
            over "Lamp" (
                variants = {
                    string power = "low"
                }
            ) {}
        }
        "wild" {
            over "Lamp" (
                variants = {
                    string power = "high"
                }
            ) {}
        }
    }
    variantSet "size" = {
        "small" {
            over "Spot" {
                float inputs:intensity = 50000
            }
        }
        "large" {
            over "Spot" {
                float inputs:intensity = 90000
            }
        }
    }
    def "Lamp" (prepend variantSets = "power") {
        variantSet "power" = {
            "low" {
                def SphereLight "Bulb" {
                    bool inputs:normalize = 1
                    float inputs:intensity = 10000
                }
            }
            "high" {
                def SphereLight "Bulb" {
                    bool inputs:normalize = 1
                    float inputs:intensity = 20000
                }
            }
        }
    }
    def SphereLight "Spot" {
        bool inputs:normalize = 1
    }
}"""


def test_values_of_variants_are_converted_in_each(tmp_path: Path) -> None:
    stage = stage_of(NESTED, tmp_path)

    def intensity(name: str) -> float:
        return float(stage.GetAttributeAtPath(f"{ROOM}/{name}.inputs:intensity").Get())

    assert (intensity("Lamp/Bulb"), intensity("Spot")) == pytest.approx((1, 5))
    sets = stage.GetDefaultPrim().GetVariantSets()
    sets.SetSelection("mood", "wild")
    sets.SetSelection("size", "large")
    assert (intensity("Lamp/Bulb"), intensity("Spot")) == pytest.approx((2, 9))
    stage.GetPrimAtPath(f"{ROOM}/Lamp").GetVariantSets().SetSelection("power", "low")
    assert intensity("Lamp/Bulb") == pytest.approx(1)


def test_values_of_variant_sets_within_variants_are_converted(tmp_path: Path) -> None:
    light = """
                    def SphereLight "Lamp" {{
                        bool inputs:normalize = 1
                        float inputs:intensity = {}
                    }}"""
    body = f"""
def Xform "Room" (
    prepend variantSets = "roof"
    variants = {{
        string roof = "open"
    }}
) {{
    variantSet "roof" = {{
        "open" {{}}
        "closed" (
            prepend variantSets = "lamps"
            variants = {{
                string lamps = "weak"
            }}
        ) {{
            variantSet "lamps" = {{
                "weak" {{{light.format(10000)}
                }}
                "strong" {{{light.format(50000)}
                    def Camera "Close" {{}}
                }}
            }}
        }}
    }}
}}"""
    stage = stage_of(body, tmp_path)
    assert not stage.GetPrimAtPath(f"{ROOM}/Lamp")
    stage.GetDefaultPrim().GetVariantSets().SetSelection("roof", "closed")
    lamp = f"{ROOM}/Lamp.inputs:intensity"
    assert stage.GetAttributeAtPath(lamp).Get() == pytest.approx(1)
    stage.GetPrimAtPath(ROOM).GetVariantSets().SetSelection("lamps", "strong")
    assert stage.GetAttributeAtPath(lamp).Get() == pytest.approx(5)
    assert stage.GetAttributeAtPath(f"{ROOM}/Close.focalLength").Get() == pytest.approx(0.5)


def test_joined_stage_may_be_a_room_of_another_one(tmp_path: Path) -> None:
    """Its root's variants select those of the rooms, in which the values are."""
    inner = stage_of(NESTED, tmp_path)
    home = inner.GetRootLayer().realPath
    (tmp_path / "outer").mkdir()
    cellar = write_cellar(tmp_path / "outer", 0.001, "Z")
    path = join([(cellar, (0.0, 0.0, -90.0)), RoomPlacement(home, name="home")], tmp_path / "outer" / "house.usda")
    stage = Usd.Stage.Open(str(path))
    for mood, power in (("wild", 2), ("calm", 1)):
        stage.GetDefaultPrim().GetVariantSets().SetSelection("mood", mood)
        bulb = stage.GetAttributeAtPath("/House/home/studio/Lamp/Bulb.inputs:intensity")
        assert bulb.Get() == pytest.approx(power * 1e6)


def test_value_that_depends_on_two_variant_sets_is_named(tmp_path: Path) -> None:
    lamp = 'over "Lamp"\n{{\nfloat inputs:intensity = {}\n}}\n'
    sets = {"a": {"own": lamp.format(1), "none": ""}, "b": {"low": lamp.format(2), "high": lamp.format(3)}}
    text = "".join(
        f'variantSet "{name}" = {{\n' + "".join(f'"{each}" {{\n{over}}}\n' for each, over in variants.items()) + "}\n"
        for name, variants in sets.items()
    )
    body = (
        'def Xform "Room" (\nprepend variantSets = ["a", "b"]\n'
        'variants = {\nstring a = "none"\nstring b = "low"\n}\n)\n'
        f'{{\n{text}def SphereLight "Lamp"\n{{\nbool inputs:normalize = 1\n}}\n}}'
    )
    with pytest.warns(StageWarning, match=r"depends on the variant sets a and b: it is converted for those of a"):
        stage_of(body, tmp_path)

# SPDX-License-Identifier: Apache-2.0
"""The templates of kitchen and hall: appliances, cookware, food, footwear, furniture of the hall."""

from __future__ import annotations

from usd_scenes.author.models import appliances, footwear, hall, kitchen, pantry, plants
from usd_scenes.author.template_model import TemplateModel

ENAMELS = {each: {"EnamelRed": f"Enamel{each.title()}"} for each in ("red", "blue", "mint", "cream")}
WOODS = {"oak": {}, "walnut": {"Oak": "Walnut"}, "chestnut": {"Oak": "Chestnut"}}


def _enamels(first: str, *others: str) -> dict[str, dict[str, str]]:
    """Return colors of enamel, `first` being the model's own."""
    return {each: {f"Enamel{first.title()}": f"Enamel{each.title()}"} for each in (first, *others)}


KITCHEN_AND_HALL: dict[str, TemplateModel] = {
    "fridge_01": TemplateModel(lambda: appliances.fridge("Fridge01"), _enamels("cream", "mint", "red", "white")),
    "stove_01": TemplateModel(
        lambda: appliances.stove("Stove01"),
        {
            "steel": {},
            "white": {"BrushedSteel": "EnamelWhite"},
            "black": {"BrushedSteel": "EnamelBlack"},
            "red": {"BrushedSteel": "EnamelRed"},
        },
    ),
    "sink_01": TemplateModel(
        lambda: appliances.sink("Sink01"),
        {"white": {}, "cream": {"Ceramic": "FireclayCream"}, "gray": {"Ceramic": "FireclayGray"}},
    ),
    "toaster_01": TemplateModel(lambda: appliances.toaster("Toaster01"), _enamels("mint", "cream", "red", "blue")),
    "kettle_01": TemplateModel(lambda: appliances.kettle("Kettle01"), ENAMELS | {"steel": {"EnamelRed": "Steel"}}),
    "pan_01": TemplateModel(
        lambda: pantry.pan("Pan01"),
        {"iron": {}, "copper": {"CastIron": "CopperPan"}, "steel": {"CastIron": "BrushedSteel"}},
    ),
    "cutting_board_01": TemplateModel(lambda: pantry.cutting_board("CuttingBoard01"), WOODS),
    "storage_jar_01": TemplateModel(
        lambda: pantry.storage_jar("StorageJar01"),
        {
            "white": {},
            "cream": {"Porcelain": "CreamGlaze", "BlueGlaze": "Stoneware"},
            "blue": {"Porcelain": "BlueGlaze", "BlueGlaze": "Porcelain"},
        },
    ),
    "bottle_01": TemplateModel(
        lambda: pantry.bottle("Bottle01"),
        {
            "green": {},
            "brown": {"GreenBottle": "BrownBottle", "EnamelRed": "EnamelBlue"},
            "yellow": {"GreenBottle": "ClearBottle", "EnamelRed": "GreenGlaze"},
        },
    ),
    "bread_01": TemplateModel(
        lambda: pantry.bread("Bread01"), {"wheat": {}, "rye": {"Crust": "CrustRye"}, "white": {"Crust": "CrustWhite"}}
    ),
    "fruit_bowl_01": TemplateModel(
        lambda: pantry.fruit_bowl("FruitBowl01"),
        {
            "stoneware": {},
            "blue": {"Stoneware": "BlueGlaze", "Apple": "ApplePale"},
            "cream": {"Stoneware": "CreamGlaze"},
        },
    ),
    "utensils_01": TemplateModel(
        lambda: pantry.utensils("Utensils01"),
        {
            "sand": {},
            "blue": {"SandGlaze": "BlueGlaze", "PineWood": "Walnut"},
            "green": {"SandGlaze": "GreenGlaze"},
        },
    ),
    "stool_01": TemplateModel(lambda: kitchen.counter_stool("Stool01"), WOODS),
    "plant_02": TemplateModel(
        lambda: plants.rubber_plant("Plant02", 1.20, 57),
        {"stoneware": {}, "clay": {"Stoneware": "Terracotta"}, "white": {"Stoneware": "Porcelain"}},
    ),
    "vase_01": TemplateModel(
        lambda: plants.vase_of_branches("Vase01"),
        {
            "sand": {},
            "clay": {"SandGlaze": "Terracotta"},
            "blue": {"SandGlaze": "BlueGlaze"},
        },
    ),
    "shoes_01": TemplateModel(
        lambda: footwear.shoes("Shoes01"),
        {each: {"CanvasRed": f"Canvas{each.title()}"} for each in ("red", "navy", "gray")},
    ),
    "boots_01": TemplateModel(
        lambda: footwear.boots("Boots01"),
        {
            "green": {},
            "yellow": {"RubberGreen": "RubberYellow"},
            "red": {"RubberGreen": "RubberRed"},
        },
    ),
    "coat_rack_01": TemplateModel(
        lambda: hall.coat_rack("CoatRack01"),
        {"walnut": {}, "oak": {"Walnut": "Oak"}, "black": {"Walnut": "BlackMetal"}},
    ),
    "hat_01": TemplateModel(
        lambda: hall.hat("Hat01"),
        {
            "gray": {},
            "camel": {"Felt": "PlushTan", "BlackMetal": "Walnut"},
            "navy": {"Felt": "CanvasNavy"},
        },
    ),
    "umbrella_stand_01": TemplateModel(
        lambda: hall.umbrella_stand("UmbrellaStand01"),
        {
            "navy": {},
            "yellow": {"UmbrellaNavy": "UmbrellaYellow"},
            "brass": {"BlackMetal": "Brass", "UmbrellaWine": "UmbrellaYellow"},
        },
    ),
    "mirror_01": TemplateModel(
        lambda: hall.arched_mirror("Mirror01"),
        {"oak": {}, "black": {"Oak": "BlackMetal"}, "brass": {"Oak": "Brass"}},
    ),
    "suitcase_01": TemplateModel(
        lambda: hall.suitcase("Suitcase01"),
        {each: {"ShellTeal": f"Shell{each.title()}"} for each in ("teal", "mustard", "black", "white")},
    ),
}

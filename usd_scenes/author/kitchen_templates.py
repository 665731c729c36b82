# SPDX-License-Identifier: Apache-2.0
"""The templates of kitchen and hall: appliances, cookware, food, footwear, furniture of the hall."""

from __future__ import annotations

from usd_scenes.author.models import appliances, footwear, hall, kitchen, pantry, plants
from usd_scenes.author.template_model import TemplateModel, replacing, shades

ENAMELS = shades("Enamel", "red", "blue", "mint", "cream")
WOODS = replacing("Oak", oak="Oak", walnut="Walnut", chestnut="Chestnut")

KITCHEN_AND_HALL: dict[str, TemplateModel] = {
    "fridge_01": TemplateModel("Fridge01", appliances.fridge, shades("Enamel", "cream", "mint", "red", "white")),
    "stove_01": TemplateModel(
        "Stove01",
        appliances.stove,
        replacing("BrushedSteel", steel="BrushedSteel", white="EnamelWhite", black="EnamelBlack", red="EnamelRed"),
    ),
    "sink_01": TemplateModel(
        "Sink01", appliances.sink, replacing("Ceramic", white="Ceramic", cream="FireclayCream", gray="FireclayGray")
    ),
    "toaster_01": TemplateModel("Toaster01", appliances.toaster, shades("Enamel", "mint", "cream", "red", "blue")),
    "kettle_01": TemplateModel("Kettle01", appliances.kettle, ENAMELS | {"steel": {"EnamelRed": "Steel"}}),
    "pan_01": TemplateModel(
        "Pan01", pantry.pan, replacing("CastIron", iron="CastIron", copper="CopperPan", steel="BrushedSteel")
    ),
    "cutting_board_01": TemplateModel("CuttingBoard01", pantry.cutting_board, WOODS),
    "storage_jar_01": TemplateModel(
        "StorageJar01",
        pantry.storage_jar,
        {
            "white": {},
            "cream": {"Porcelain": "CreamGlaze", "BlueGlaze": "Stoneware"},
            "blue": {"Porcelain": "BlueGlaze", "BlueGlaze": "Porcelain"},
        },
    ),
    "bottle_01": TemplateModel(
        "Bottle01",
        pantry.bottle,
        {
            "green": {},
            "brown": {"GreenBottle": "BrownBottle", "EnamelRed": "EnamelBlue"},
            "yellow": {"GreenBottle": "ClearBottle", "EnamelRed": "GreenGlaze"},
        },
    ),
    "bread_01": TemplateModel(
        "Bread01", pantry.bread, replacing("Crust", wheat="Crust", rye="CrustRye", white="CrustWhite")
    ),
    "fruit_bowl_01": TemplateModel(
        "FruitBowl01",
        pantry.fruit_bowl,
        {
            "stoneware": {},
            "blue": {"Stoneware": "BlueGlaze", "Apple": "ApplePale"},
            "cream": {"Stoneware": "CreamGlaze"},
        },
    ),
    "utensils_01": TemplateModel(
        "Utensils01",
        pantry.utensils,
        {"sand": {}, "blue": {"SandGlaze": "BlueGlaze", "PineWood": "Walnut"}, "green": {"SandGlaze": "GreenGlaze"}},
    ),
    "stool_01": TemplateModel("Stool01", kitchen.counter_stool, WOODS),
    "plant_02": TemplateModel(
        "Plant02",
        lambda name: plants.rubber_plant(name, 1.2, 57),
        replacing("Stoneware", stoneware="Stoneware", clay="Terracotta", white="Porcelain"),
    ),
    "vase_01": TemplateModel(
        "Vase01", plants.vase_of_branches, replacing("SandGlaze", sand="SandGlaze", clay="Terracotta", blue="BlueGlaze")
    ),
    "shoes_01": TemplateModel("Shoes01", footwear.shoes, shades("Canvas", "red", "navy", "gray")),
    "boots_01": TemplateModel("Boots01", footwear.boots, shades("Rubber", "green", "yellow", "red")),
    "coat_rack_01": TemplateModel(
        "CoatRack01", hall.coat_rack, replacing("Walnut", walnut="Walnut", oak="Oak", black="BlackMetal")
    ),
    "hat_01": TemplateModel(
        "Hat01",
        hall.hat,
        {"gray": {}, "camel": {"Felt": "PlushTan", "BlackMetal": "Walnut"}, "navy": {"Felt": "CanvasNavy"}},
    ),
    "umbrella_stand_01": TemplateModel(
        "UmbrellaStand01",
        hall.umbrella_stand,
        {
            "navy": {},
            "yellow": {"UmbrellaNavy": "UmbrellaYellow"},
            "brass": {"BlackMetal": "Brass", "UmbrellaWine": "UmbrellaYellow"},
        },
    ),
    "mirror_01": TemplateModel(
        "Mirror01", hall.arched_mirror, replacing("Oak", oak="Oak", black="BlackMetal", brass="Brass")
    ),
    "suitcase_01": TemplateModel("Suitcase01", hall.suitcase, shades("Shell", "teal", "mustard", "black", "white")),
}

# SPDX-License-Identifier: Apache-2.0
"""The materials of all models by name (`PRESETS`), with and without textures.

Albedos are measured values or close to them: none below 0.03 or above 0.82.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from usd_scenes.author.textures.images import decoded

TEXTURES = Path(__file__).resolve().parents[1] / "textures"
Color = tuple[float, float, float]


@dataclass(frozen=True)
class MaterialPreset:
    """Inputs of a UsdPreviewSurface. A string is a texture file in `usd_scenes/textures`.

    Attributes:
        color: diffuse color, linear.
        roughness: 0..1.
        metallic: 0..1.
        normal: normal map, or None.
        tile: size of the surface that a texture covers along u and v, m; None: uv is in 0..1 already.
        emission: emitted radiance, linear, before `emission_scale`; None for none.
        emission_scale: factor of `emission`.
        clearcoat: 0..1.
        ior: index of refraction.
        opacity: 0..1.
        shift: translation in texture space.
        average: mean of the color texture, where only a part of it is used; None: computed.
    """

    color: Color | str
    roughness: float | str = 0.5
    metallic: float = 0.0
    normal: str | None = None
    tile: tuple[float, float] | None = (1.0, 1.0)
    emission: Color | str | None = None
    emission_scale: float = 1.0
    clearcoat: float = 0.0
    ior: float = 1.5
    opacity: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    average: Color | None = None


def without_textures(preset: MaterialPreset) -> MaterialPreset:
    """Return a preset with its textures replaced by their means."""
    color = preset.average or (_mean_albedo(preset.color) if isinstance(preset.color, str) else preset.color)
    roughness = _mean(preset.roughness) if isinstance(preset.roughness, str) else preset.roughness
    emission = _mean_albedo(preset.emission) if isinstance(preset.emission, str) else preset.emission
    if emission is not None:
        red, green, blue = (component * preset.emission_scale for component in emission)
        emission = red, green, blue
    return replace(preset, color=color, roughness=roughness, emission=emission, emission_scale=1.0, normal=None)


@cache
def _mean_albedo(file: str) -> Color:
    """Return the mean linear color of an sRGB image, rounded to two decimals to be independent of its last bits."""
    with Image.open(TEXTURES / file) as picture:
        albedo = decoded(np.asarray(picture.convert("RGB"), dtype=np.float64) / 255.0)
    red, green, blue = np.round(albedo.mean(axis=(0, 1)), 2).tolist()
    return red, green, blue


@cache
def _mean(file: str) -> float:
    """Return the mean of a grayscale image, 0..1, rounded to two decimals."""
    with Image.open(TEXTURES / file) as picture:
        return round(float(np.asarray(picture, dtype=np.float64).mean()) / 255.0, 2)


def _textured(name: str, tile: float | tuple[float, float], **others: object) -> MaterialPreset:
    """Return a preset whose color, roughness and normal textures share a name."""
    size = tile if isinstance(tile, tuple) else (tile, tile)
    roughness = f"{name}_roughness.png"
    fields = {"color": f"{name}_color.png", "roughness": roughness, "normal": f"{name}_normal.png", "tile": size}
    return MaterialPreset(**{**fields, **others})  # type: ignore[arg-type]


PRESETS: dict[str, MaterialPreset] = {
    # Building
    "WallPlaster": MaterialPreset((0.70, 0.675, 0.63), 0.85, normal="plaster_normal.png", tile=(1.2, 1.2)),
    "AccentPlaster": MaterialPreset((0.245, 0.305, 0.285), 0.8, normal="plaster_normal.png", tile=(1.2, 1.2)),
    "CeilingPaint": MaterialPreset((0.78, 0.775, 0.76), 0.9, normal="plaster_normal.png", tile=(1.7, 1.7)),
    "TrimPaint": MaterialPreset((0.72, 0.71, 0.68), 0.32),
    "OakFloor": _textured("oak", (2.4, 1.92)),
    "FloorGap": MaterialPreset((0.035, 0.028, 0.02), 0.9),
    # Woods
    "Oak": _textured("oak_board", (1.6, 0.8)),
    "Walnut": _textured("walnut_board", (1.6, 0.8)),
    "Chestnut": _textured("chestnut_board", (1.6, 0.8)),
    # Cloth
    "Linen": MaterialPreset("linen_color.png", 0.95, normal="fine_weave_normal.png", tile=(0.24, 0.24)),
    "SofaWool": MaterialPreset("wool_color.png", 0.95, normal="weave_normal.png", tile=(0.24, 0.24)),
    "Mustard": MaterialPreset("mustard_color.png", 0.95, normal="weave_normal.png", tile=(0.24, 0.24)),
    "Rust": MaterialPreset("rust_color.png", 0.95, normal="weave_normal.png", tile=(0.24, 0.24)),
    "Cream": MaterialPreset("cream_color.png", 0.95, normal="weave_normal.png", tile=(0.24, 0.24)),
    "Leather": _textured("leather", 0.5),
    "Rug": _textured("rug", (3.2, 2.3), roughness=0.95),
    "ScribbleCotton": MaterialPreset("scribble_color.png", 0.9, normal=None, tile=None),
    "ThrowWool": MaterialPreset("throw_color.png", 0.95, normal="weave_normal.png", tile=(0.24, 0.24)),
    "LampShade": MaterialPreset(
        "linen_color.png", 0.9, tile=(0.24, 0.24), emission=(1.0, 0.74, 0.48), emission_scale=0.25
    ),
    # Rooms
    "ClayPlaster": MaterialPreset((0.50, 0.365, 0.29), 0.85, normal="plaster_normal.png", tile=(1.2, 1.2)),
    "SagePaint": MaterialPreset((0.33, 0.36, 0.31), 0.34),
    "Oatmeal": MaterialPreset("oatmeal_color.png", 0.95, normal="weave_normal.png", tile=(0.24, 0.24)),
    "BedSheet": MaterialPreset((0.74, 0.73, 0.70), 0.9, normal="fine_weave_normal.png", tile=(0.24, 0.24)),
    "DuvetLinen": MaterialPreset("ticking_color.png", 0.92, normal="fine_weave_normal.png", tile=(0.24, 0.24)),
    "BlueLinen": MaterialPreset("blue_linen_color.png", 0.95, normal="fine_weave_normal.png", tile=(0.24, 0.24)),
    "Berber": _textured("berber", (2.3, 1.6), roughness=0.95),
    "BedsideShade": MaterialPreset(
        "linen_color.png", 0.9, tile=(0.24, 0.24), emission=(1.0, 0.74, 0.48), emission_scale=0.5
    ),
    "SandGlaze": MaterialPreset((0.50, 0.42, 0.32), 0.35),
    "BathPlaster": MaterialPreset((0.66, 0.635, 0.59), 0.75, normal="plaster_normal.png", tile=(1.2, 1.2)),
    "Zellige": _textured("zellige", 1.0, clearcoat=0.6),
    "ZelligeTrim": MaterialPreset((0.30, 0.40, 0.385), 0.12),
    "Grout": MaterialPreset((0.56, 0.55, 0.52), 0.9),
    "Terrazzo": MaterialPreset("terrazzo_color.png", 0.28, tile=(1.0, 1.0)),
    "Acrylic": MaterialPreset((0.76, 0.755, 0.74), 0.12),
    "Ceramic": MaterialPreset((0.77, 0.765, 0.75), 0.08),
    "SeatPlastic": MaterialPreset((0.75, 0.745, 0.73), 0.22),
    "Chrome": MaterialPreset((0.66, 0.67, 0.68), 0.06, metallic=1.0),
    "BrushedSteel": MaterialPreset((0.56, 0.555, 0.545), 0.32, metallic=1.0),
    "CounterStone": MaterialPreset((0.62, 0.60, 0.565), 0.3),
    "FrostedPane": MaterialPreset((0.55, 0.57, 0.57), 0.5),
    "OpalGlobe": MaterialPreset((0.78, 0.77, 0.74), 0.2),
    "TerryWhite": MaterialPreset((0.74, 0.73, 0.70), 0.95, normal="terry_normal.png", tile=(0.09, 0.09)),
    "TerryClay": MaterialPreset((0.47, 0.29, 0.21), 0.95, normal="terry_normal.png", tile=(0.09, 0.09)),
    "AmberGlass": MaterialPreset((0.16, 0.062, 0.018), 0.08),
    "Soap": MaterialPreset((0.60, 0.64, 0.50), 0.4),
    "ToiletPaper": MaterialPreset((0.76, 0.75, 0.73), 0.95),
    "BrushTeal": MaterialPreset((0.05, 0.30, 0.30), 0.35),
    "BrushCoral": MaterialPreset((0.55, 0.17, 0.12), 0.35),
    "PlainWall": MaterialPreset((0.62, 0.615, 0.60), 0.9),
    "PlainWallWarm": MaterialPreset((0.60, 0.47, 0.38), 0.9),
    "PlainWallCool": MaterialPreset((0.40, 0.49, 0.52), 0.9),
    "PlainFloor": MaterialPreset((0.48, 0.47, 0.45), 0.55),
    "ClearGlass": MaterialPreset((0.76, 0.77, 0.76), 0.0, opacity=0.0),
    # Metals and ceramics
    "Brass": MaterialPreset((0.78, 0.58, 0.30), 0.28, metallic=1.0),
    "Steel": MaterialPreset((0.60, 0.59, 0.57), 0.25, metallic=1.0),
    "Aluminium": MaterialPreset((0.72, 0.73, 0.74), 0.34, metallic=1.0),
    "MirrorSilver": MaterialPreset((0.80, 0.80, 0.79), 0.02, metallic=1.0),
    "PaleStone": MaterialPreset((0.60, 0.57, 0.51), 0.6),
    "BlackMetal": MaterialPreset((0.045, 0.044, 0.042), 0.42),
    "Porcelain": MaterialPreset((0.76, 0.75, 0.71), 0.12),
    "CreamGlaze": MaterialPreset((0.66, 0.58, 0.42), 0.16),
    "BlueGlaze": MaterialPreset((0.05, 0.12, 0.27), 0.14),
    "Stoneware": MaterialPreset((0.26, 0.235, 0.20), 0.55),
    "Terracotta": MaterialPreset((0.44, 0.19, 0.095), 0.75),
    "Candle": MaterialPreset((0.70, 0.64, 0.52), 0.5),
    # Plastics, paper, plants, food
    "BlackPlastic": MaterialPreset((0.04, 0.04, 0.042), 0.38),
    "GrayPlastic": MaterialPreset((0.20, 0.20, 0.205), 0.45),
    "WhitePlastic": MaterialPreset((0.70, 0.70, 0.68), 0.35),
    "RedButton": MaterialPreset((0.45, 0.04, 0.03), 0.4),
    "ScreenOff": MaterialPreset((0.035, 0.035, 0.037), 0.08),
    "Keys": MaterialPreset((0.05, 0.05, 0.053), 0.5),
    "LaptopScreen": MaterialPreset(
        (0.04, 0.04, 0.04), 0.15, tile=None, emission="screen_color.png", emission_scale=1.3
    ),
    "Pages": MaterialPreset("pages_color.png", 0.9, tile=(0.25, 0.25)),
    "Spines": MaterialPreset("spines_color.png", 0.6, tile=None),
    "Paper": MaterialPreset((0.72, 0.70, 0.66), 0.85),
    "Landscape": MaterialPreset("landscape_color.png", 0.45, tile=None),
    "Coast": MaterialPreset("coast_color.png", 0.45, tile=None),
    "Meadow": MaterialPreset("meadow_color.png", 0.45, tile=None),
    "SprigLong": MaterialPreset("sprig_long_color.png", 0.8, tile=None),
    "SprigRound": MaterialPreset("sprig_round_color.png", 0.8, tile=None),
    "Arches": MaterialPreset("arches_color.png", 0.8, tile=None),
    "AbstractWarm": MaterialPreset("abstract_warm_color.png", 0.8, tile=None),
    "AbstractCool": MaterialPreset("abstract_cool_color.png", 0.8, tile=None),
    "Leaf": MaterialPreset((0.055, 0.13, 0.035), 0.36),
    "LeafPale": MaterialPreset((0.10, 0.19, 0.05), 0.42),
    "Bark": MaterialPreset((0.13, 0.085, 0.05), 0.85),
    "Soil": MaterialPreset((0.045, 0.032, 0.024), 0.95),
    "Lemon": MaterialPreset((0.70, 0.50, 0.035), 0.42),
    "Apple": MaterialPreset((0.42, 0.055, 0.03), 0.25),
    # Sports
    "RacketFrame": MaterialPreset((0.48, 0.035, 0.03), 0.22, clearcoat=1.0),
    "RacketWhite": MaterialPreset((0.72, 0.71, 0.68), 0.25, clearcoat=1.0),
    "RacketString": MaterialPreset((0.70, 0.66, 0.52), 0.45),
    "Grip": MaterialPreset((0.05, 0.05, 0.055), 0.8),
    "BallRed": MaterialPreset((0.56, 0.05, 0.035), 0.35),
    "BallWhite": MaterialPreset((0.74, 0.73, 0.69), 0.35),
    "BallBlue": MaterialPreset((0.04, 0.14, 0.42), 0.35),
    "BallYellow": MaterialPreset((0.72, 0.50, 0.04), 0.35),
    # Templates: other colors
    "PillowMustard": MaterialPreset("mustard_color.png", 0.95, normal="weave_normal.png", tile=(0.5, 0.5)),
    "PillowTeal": MaterialPreset((0.06, 0.20, 0.20), 0.95, normal="weave_normal.png", tile=(0.5, 0.5)),
    "PillowRust": MaterialPreset("rust_color.png", 0.95, normal="weave_normal.png", tile=(0.5, 0.5)),
    "GreenGlaze": MaterialPreset((0.10, 0.20, 0.11), 0.14),
    "SpinesBlue": MaterialPreset("spines_color.png", 0.6, tile=None, shift=(1 / 16, 0.0), average=(0.05, 0.085, 0.17)),
    "SpinesGreen": MaterialPreset(
        "spines_color.png", 0.6, tile=None, shift=(2 / 16, 0.0), average=(0.055, 0.12, 0.085)
    ),
    "SpinesCream": MaterialPreset("spines_color.png", 0.6, tile=None, shift=(10 / 16, 0.0), average=(0.68, 0.64, 0.57)),
    "CandleRed": MaterialPreset((0.42, 0.045, 0.035), 0.5),
    "CandleGreen": MaterialPreset((0.09, 0.17, 0.10), 0.5),
    "BlackSteel": MaterialPreset((0.09, 0.09, 0.095), 0.3, metallic=1.0),
    "Bronze": MaterialPreset((0.42, 0.25, 0.13), 0.35, metallic=1.0),
    "Graphite": MaterialPreset((0.20, 0.205, 0.215), 0.36, metallic=1.0),
    "RoseGold": MaterialPreset((0.78, 0.60, 0.48), 0.34, metallic=1.0),
    "BallPink": MaterialPreset((0.68, 0.27, 0.30), 0.35),
    "BallMint": MaterialPreset((0.26, 0.56, 0.42), 0.35),
    "BallSky": MaterialPreset((0.22, 0.45, 0.66), 0.35),
    "RacketBlue": MaterialPreset((0.025, 0.11, 0.42), 0.22, clearcoat=1.0),
    "RacketBlack": MaterialPreset((0.035, 0.035, 0.037), 0.22, clearcoat=1.0),
    "RacketLime": MaterialPreset((0.45, 0.62, 0.05), 0.25, clearcoat=1.0),
    "LeatherBlack": MaterialPreset(
        (0.04, 0.037, 0.035), "leather_roughness.png", normal="leather_normal.png", tile=(0.5, 0.5)
    ),
    "LeatherGreen": MaterialPreset(
        (0.055, 0.10, 0.06), "leather_roughness.png", normal="leather_normal.png", tile=(0.5, 0.5)
    ),
    "SpinesRed": MaterialPreset("spines_color.png", 0.6, tile=None, average=(0.30, 0.055, 0.045)),
    "ShellWhite": MaterialPreset((0.68, 0.67, 0.64), 0.34),
    "ShellTeal": MaterialPreset((0.075, 0.23, 0.25), 0.34),
    "ShellMustard": MaterialPreset((0.56, 0.34, 0.055), 0.34),
    "ShellBlack": MaterialPreset((0.04, 0.04, 0.042), 0.34),
    "PhoneCase": MaterialPreset((0.075, 0.085, 0.105), 0.30, metallic=0.6),
    "PhoneRose": MaterialPreset((0.62, 0.33, 0.33), 0.30, metallic=0.6),
    "PhoneSilver": MaterialPreset((0.62, 0.63, 0.64), 0.30, metallic=0.6),
    "PhoneScreen": MaterialPreset((0.04, 0.04, 0.04), 0.1, tile=None, emission="phone_color.png", emission_scale=0.7),
    "PenBlue": MaterialPreset((0.02, 0.065, 0.30), 0.22, clearcoat=0.5),
    "PenRed": MaterialPreset((0.46, 0.025, 0.03), 0.22, clearcoat=0.5),
    "PenGreen": MaterialPreset((0.03, 0.20, 0.08), 0.22, clearcoat=0.5),
    "EnamelRed": MaterialPreset((0.44, 0.028, 0.022), 0.15),
    "EnamelBlue": MaterialPreset((0.035, 0.12, 0.25), 0.15),
    "EnamelMint": MaterialPreset((0.36, 0.56, 0.47), 0.15),
    "EnamelCream": MaterialPreset((0.68, 0.61, 0.46), 0.15),
    "Cardboard": MaterialPreset("cardboard_color.png", 0.85, tile=(0.36, 0.36)),
    "CardboardWhite": MaterialPreset((0.70, 0.69, 0.66), 0.8),
    "CardboardBlue": MaterialPreset((0.10, 0.19, 0.32), 0.8),
    "Tape": MaterialPreset((0.34, 0.20, 0.075), 0.22),
    "BinBlue": MaterialPreset((0.025, 0.13, 0.40), 0.36),
    "BinGreen": MaterialPreset((0.03, 0.25, 0.09), 0.36),
    "BinGray": MaterialPreset((0.22, 0.225, 0.23), 0.36),
    "TowelWhite": MaterialPreset((0.72, 0.71, 0.68), 0.95, normal="terry_normal.png", tile=(0.09, 0.09)),
    "TowelBlue": MaterialPreset((0.15, 0.25, 0.36), 0.95, normal="terry_normal.png", tile=(0.09, 0.09)),
    "TowelRose": MaterialPreset((0.55, 0.28, 0.26), 0.95, normal="terry_normal.png", tile=(0.09, 0.09)),
    "TowelSage": MaterialPreset((0.27, 0.34, 0.23), 0.95, normal="terry_normal.png", tile=(0.09, 0.09)),
    "TowelBand": MaterialPreset((0.62, 0.58, 0.50), 0.8, normal="fine_weave_normal.png", tile=(0.12, 0.12)),
    "Tissue": MaterialPreset((0.76, 0.755, 0.74), 0.9, normal="quilted_normal.png", tile=(0.06, 0.06)),
    "TissuePeach": MaterialPreset((0.74, 0.55, 0.45), 0.9, normal="quilted_normal.png", tile=(0.06, 0.06)),
    "TissueBlue": MaterialPreset((0.50, 0.60, 0.68), 0.9, normal="quilted_normal.png", tile=(0.06, 0.06)),
    "SoapIvory": MaterialPreset((0.74, 0.68, 0.54), 0.35),
    "SoapPink": MaterialPreset((0.72, 0.40, 0.40), 0.35),
    "SoapGreen": MaterialPreset((0.38, 0.56, 0.36), 0.35),
    "RubberRed": MaterialPreset((0.33, 0.060, 0.035), 0.55),
    "RubberBlack": MaterialPreset((0.038, 0.037, 0.036), 0.55),
    "RubberGreen": MaterialPreset((0.05, 0.17, 0.10), 0.55),
    "PlushBrown": MaterialPreset("plush_color.png", 0.95, normal="plush_normal.png", tile=(0.12, 0.12)),
    "PlushCream": MaterialPreset((0.62, 0.53, 0.39), 0.95, normal="plush_normal.png", tile=(0.12, 0.12)),
    "PlushGray": MaterialPreset((0.28, 0.28, 0.29), 0.95, normal="plush_normal.png", tile=(0.12, 0.12)),
    "PlushTan": MaterialPreset((0.50, 0.37, 0.22), 0.95, normal="plush_normal.png", tile=(0.12, 0.12)),
    "BlackGloss": MaterialPreset((0.035, 0.033, 0.032), 0.12),
    "RibbonRed": MaterialPreset((0.48, 0.035, 0.045), 0.42),
    "RibbonBlue": MaterialPreset((0.05, 0.15, 0.40), 0.42),
    "SnakeLeaf": MaterialPreset("snake_leaf_color.png", 0.38, tile=None),
    "PineWood": _textured("oak_board", (1.6, 0.8), color=(0.52, 0.38, 0.22)),
    "LampGlow": MaterialPreset((0.8, 0.8, 0.8), 0.3, emission=(1.0, 0.60, 0.28), emission_scale=9.0),
    "ShadeRed": MaterialPreset(
        "rust_color.png", 0.9, tile=(0.24, 0.24), emission=(1.0, 0.30, 0.10), emission_scale=0.20
    ),
    "ShadeBlue": MaterialPreset((0.16, 0.22, 0.26), 0.9, emission=(0.55, 0.62, 0.45), emission_scale=0.18),
    # Kitchen and hall
    "CabinetGreen": MaterialPreset((0.105, 0.150, 0.125), 0.36),
    "WarmPlaster": MaterialPreset((0.69, 0.645, 0.565), 0.85, normal="plaster_normal.png", tile=(1.2, 1.2)),
    "HallPaint": MaterialPreset((0.215, 0.275, 0.315), 0.55, normal="plaster_normal.png", tile=(1.2, 1.2)),
    "Marble": MaterialPreset("marble_color.png", 0.16, tile=(1.4, 1.4)),
    "MetroTile": _textured("zellige", 1.0, color=(0.68, 0.665, 0.62), roughness=0.14, clearcoat=0.4),
    "CementLight": MaterialPreset("cement_color.png", 0.55, tile=(1.0, 1.0)),
    "CementDark": MaterialPreset((0.085, 0.092, 0.098), 0.5),
    "OvenGlass": MaterialPreset((0.035, 0.034, 0.033), 0.05),
    "CastIron": MaterialPreset((0.042, 0.042, 0.044), 0.55),
    "CopperPan": MaterialPreset((0.72, 0.40, 0.27), 0.22, metallic=1.0),
    "GreenBottle": MaterialPreset((0.035, 0.060, 0.020), 0.05, clearcoat=1.0),
    "BrownBottle": MaterialPreset((0.085, 0.036, 0.012), 0.05, clearcoat=1.0),
    "ClearBottle": MaterialPreset((0.46, 0.40, 0.16), 0.05, clearcoat=1.0),
    "Cork": MaterialPreset((0.42, 0.28, 0.16), 0.85),
    "Crust": MaterialPreset("crust_color.png", 0.75, tile=(0.30, 0.30)),
    "CrustRye": MaterialPreset((0.155, 0.072, 0.030), 0.8, normal="plush_normal.png", tile=(0.4, 0.4)),
    "CrustWhite": MaterialPreset((0.60, 0.44, 0.25), 0.75, normal="plush_normal.png", tile=(0.5, 0.5)),
    "Banana": MaterialPreset((0.68, 0.46, 0.045), 0.45),
    "ApplePale": MaterialPreset((0.36, 0.42, 0.07), 0.25),
    "EnamelWhite": MaterialPreset((0.74, 0.735, 0.715), 0.15),
    "EnamelBlack": MaterialPreset((0.038, 0.038, 0.040), 0.15),
    "FireclayGray": MaterialPreset((0.24, 0.245, 0.25), 0.14),
    "FireclayCream": MaterialPreset((0.68, 0.625, 0.51), 0.10),
    "UmbrellaNavy": MaterialPreset((0.035, 0.050, 0.110), 0.75, normal="fine_weave_normal.png", tile=(0.05, 0.05)),
    "UmbrellaWine": MaterialPreset((0.255, 0.035, 0.040), 0.75, normal="fine_weave_normal.png", tile=(0.05, 0.05)),
    "UmbrellaYellow": MaterialPreset((0.66, 0.42, 0.05), 0.75, normal="fine_weave_normal.png", tile=(0.05, 0.05)),
    "CanvasRed": MaterialPreset((0.40, 0.045, 0.040), 0.9, normal="fine_weave_normal.png", tile=(0.12, 0.12)),
    "CanvasNavy": MaterialPreset((0.035, 0.055, 0.115), 0.9, normal="fine_weave_normal.png", tile=(0.12, 0.12)),
    "CanvasGray": MaterialPreset((0.34, 0.335, 0.32), 0.9, normal="fine_weave_normal.png", tile=(0.12, 0.12)),
    "RubberYellow": MaterialPreset((0.62, 0.41, 0.035), 0.35),
    "Coir": MaterialPreset((0.21, 0.125, 0.058), 0.95, normal="plush_normal.png", tile=(0.10, 0.10)),
    "CoatWool": MaterialPreset((0.30, 0.215, 0.125), 0.95, normal="weave_normal.png", tile=(0.20, 0.20)),
    "Felt": MaterialPreset((0.105, 0.090, 0.075), 0.95, normal="plush_normal.png", tile=(0.10, 0.10)),
    "Runner": _textured("rug", (2.4, 0.9), roughness=0.95),
    # Matte primitives
    "MatteBlue": MaterialPreset((0.09, 0.20, 0.38), 0.55),
    "MatteRed": MaterialPreset((0.50, 0.085, 0.055), 0.55),
    "MatteYellow": MaterialPreset((0.66, 0.43, 0.07), 0.55),
    "MatteGreen": MaterialPreset((0.11, 0.28, 0.13), 0.55),
    "MatteTeal": MaterialPreset((0.06, 0.28, 0.28), 0.55),
    "MatteOrange": MaterialPreset((0.60, 0.22, 0.05), 0.55),
    "MatteWhite": MaterialPreset((0.72, 0.71, 0.68), 0.55),
}

# SPDX-License-Identifier: Apache-2.0
"""The texture files: `MAKERS` maps names to the functions that write them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from usd_scenes.author.textures import cloth, images, pictures, props, sky, tiles, wood
from usd_scenes.author.textures.noise import normals_from_height, spectral

Maker = Callable[[Path], None]
OAK = (0.42, 0.275, 0.15), (0.235, 0.13, 0.062)
WALNUT = (0.165, 0.094, 0.052), (0.066, 0.036, 0.021)
CHESTNUT = (0.33, 0.155, 0.07), (0.15, 0.058, 0.026)


def _surface(name: str, make: Callable[[], wood.SurfaceTextures], roughness: bool = True) -> Maker:
    def write(folder: Path) -> None:
        surface = make()
        images.save_color(folder / f"{name}_color.png", surface.color)
        images.save_normal(folder / f"{name}_normal.png", surface.normal)
        if roughness:
            images.save_raw(folder / f"{name}_roughness.png", surface.roughness)

    return write


def _color(name: str, make: Callable[[], np.ndarray]) -> Maker:
    return lambda folder: images.save_color(folder / f"{name}_color.png", make())


def _normal(name: str, make: Callable[[], np.ndarray]) -> Maker:
    return lambda folder: images.save_normal(folder / f"{name}_normal.png", make())


def _cloth(
    name: str, color: tuple[float, float, float], threads: int = 64, contrast: float = 0.2, relief: str | None = None
) -> Maker:
    """Return a maker of a dyed weave; `relief` names the normal map that it writes, too."""

    def write(folder: Path) -> None:
        surface = cloth.weave(512, 51, 0.24, threads, color, contrast)
        images.save_color(folder / f"{name}_color.png", surface.color)
        if relief is not None:
            images.save_normal(folder / f"{relief}_normal.png", surface.normal)

    return write


def _plaster(folder: Path) -> None:
    """Write the normal map of roller-painted plaster: orange-peel stipple over slow unevenness."""
    shape = (512, 512)
    height = 6.0e-5 * spectral(shape, 71, 0.006, slope=1.6) + 4.0e-4 * spectral(shape, 72, 0.12, slope=2.2)
    images.save_normal(folder / "plaster_normal.png", normals_from_height(height, 512 / 1.2))


def _rug(folder: Path) -> None:
    images.save_color(folder / "rug_color.png", cloth.rug(1024, 736, 81).color)
    images.save_normal(folder / "rug_normal.png", cloth.rug(512, 368, 81).normal)


WARM = [(0.50, 0.16, 0.07), (0.60, 0.40, 0.14), (0.16, 0.06, 0.05), (0.62, 0.45, 0.34)]
COOL = [(0.09, 0.16, 0.24), (0.40, 0.44, 0.40), (0.55, 0.35, 0.20), (0.05, 0.07, 0.09)]


def _sky(folder: Path) -> None:
    """Write the afternoon sky; the sun is where room_02 has it, out of the windows' view."""
    sun = np.array([-0.80, 0.50, 0.33])
    images.save_hdr(folder / "afternoon_sky.hdr", sky.afternoon(1024, 512, 7, sun / np.linalg.norm(sun)))


def _dusk(folder: Path) -> None:
    """Write the dusk sky; the sun has set where the afternoon's sun stands."""
    images.save_hdr(folder / "dusk_sky.hdr", sky.dusk(768, 384, 8, np.array([-0.92, 0.05, 0.38])))


def _ticking(folder: Path) -> None:
    threads = cloth.ticking(512, (0.74, 0.725, 0.69), (0.16, 0.20, 0.27))
    images.save_color(folder / "ticking_color.png", cloth.weave(512, 51, 0.24, 96, threads, 0.12).color)


def _berber(folder: Path) -> None:
    images.save_color(folder / "berber_color.png", cloth.berber(1024, 712, 111).color)
    images.save_normal(folder / "berber_normal.png", cloth.berber(512, 356, 111).normal)


MAKERS: dict[str, Maker] = {
    "afternoon_sky": _sky,
    "plaster": _plaster,
    "oak": _surface("oak", lambda: wood.boards(1024, 11, 2.4, *OAK)),
    "oak_board": _surface("oak_board", lambda: wood.board(512, 1024, 23, 1.6, *OAK)),
    "walnut_board": _surface("walnut_board", lambda: wood.board(512, 1024, 37, 1.6, *WALNUT)),
    "chestnut_board": _surface("chestnut_board", lambda: wood.board(512, 1024, 41, 1.6, *CHESTNUT)),
    "linen": _cloth("linen", (0.70, 0.655, 0.57), threads=96, relief="fine_weave"),
    "wool": _cloth("wool", (0.40, 0.37, 0.325), relief="weave"),
    "mustard": _cloth("mustard", (0.50, 0.29, 0.045)),
    "rust": _cloth("rust", (0.34, 0.095, 0.045)),
    "cream": _cloth("cream", (0.66, 0.615, 0.53)),
    "throw": _cloth("throw", (0.14, 0.19, 0.20), contrast=0.35),
    "leather": _surface("leather", lambda: cloth.leather(512, 61, 0.5, (0.24, 0.092, 0.035))),
    "rug": _rug,
    "landscape": _color("landscape", lambda: pictures.landscape(768, 512, 91)),
    "coast": _color("coast", lambda: pictures.landscape(576, 384, 191)),
    "meadow": _color("meadow", lambda: pictures.landscape(768, 512, 294, (0.85, 0.78, 0.62))),
    "sprig_long": _color("sprig_long", lambda: pictures.sprig(384, 512, 401)),
    "sprig_round": _color("sprig_round", lambda: pictures.sprig(384, 512, 404)),
    "arches": _color("arches", lambda: pictures.arches(384, 512, 403)),
    "abstract_warm": _color("abstract_warm", lambda: pictures.abstract(384, 512, 92, WARM)),
    "abstract_cool": _color("abstract_cool", lambda: pictures.abstract(384, 512, 97, COOL)),
    "spines": _color("spines", lambda: pictures.spines(1024, 93, 16)),
    "pages": _color("pages", lambda: pictures.pages(128, 94)),
    "screen": _color("screen", lambda: pictures.screen(512, 320, 95)),
    "dusk_sky": _dusk,
    "ticking": _ticking,
    "berber": _berber,
    "zellige": _surface("zellige", lambda: tiles.glaze(512, 121, 1.0, (0.36, 0.47, 0.45), (0.16, 0.25, 0.245))),
    "terrazzo": _color("terrazzo", lambda: tiles.terrazzo(1024, 122)),
    "frosted": _color("frosted", lambda: tiles.frosted(256, 256, 123)),
    "oatmeal": _cloth("oatmeal", (0.47, 0.42, 0.35), contrast=0.28),
    "blue_linen": _cloth("blue_linen", (0.22, 0.28, 0.325), threads=96),
    "phone": _color("phone", lambda: props.phone_screen(288, 592, 120)),
    "plush": _surface("plush", lambda: props.plush(256, 121, 0.12, (0.235, 0.12, 0.05)), roughness=False),
    "cardboard": _color("cardboard", lambda: props.cardboard(384, 122)),
    "terry": _normal("terry", lambda: props.terry(256, 123, 0.09)),
    "quilted": _normal("quilted", lambda: props.quilted(128, 0.06)),
    "snake_leaf": _color("snake_leaf", lambda: props.snake_leaf(64, 512, 124)),
    "marble": _color("marble", lambda: tiles.marble(512, 131)),
    "cement": _color("cement", lambda: tiles.cement(384, 132)),
    "crust": _color("crust", lambda: props.crust(256, 133)),
    "scribble": _color("scribble", lambda: pictures.scribble(512, 96)),
}

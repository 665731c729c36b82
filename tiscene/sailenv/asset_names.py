# SPDX-License-Identifier: Apache-2.0
"""SAILenv's names of scenes and templates.

SAILenv calls the scene `object_view` "object_view/scene". Its scripts also rely on names and on an order of scenes that
are recorded in `scenes.json`.
"""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any

from tiscene import catalog
from tiscene.errors import SceneNotFound, TemplateNotFound
from tiscene.scene.camera import Vector3

_OWN_STAGE = "A stage of your own is a scene once it is NAME/scene.usda in a folder of TISCENE_PATH."
_SUFFIX = "/scene"
_TRAIL = " Trail"  # ends the names of SAILenv's templates that leave a trail on the screen


@functools.cache
def sailenv_names() -> dict[str, Any]:
    """Return the contents of `scenes.json`.

    Keys: `first`, the default scene; `order`, SAILenv's scenes in its order; `trails`, templates that also exist with a
    trail; `lights`, SAILenv's names of the lights of each scene; `backgrounds`, 8-bit sRGB colors of scenes whose
    background has one color; `scales`, factors by which primitives have SAILenv's
    sizes: a cube and a sphere of 1 m, a cylinder and a capsule of 1 m across and 2 m high.
    """
    content: dict[str, Any] = json.loads(resources.files(__package__).joinpath("scenes.json").read_text("utf-8"))
    return content


def scenes() -> list[str]:
    """Return the names of all scenes ("object_view/scene"), SAILenv's own first and in its order."""
    known = list(catalog.scenes())
    first = [name for name in sailenv_names()["order"] if name in known]
    return [name + _SUFFIX for name in first + [name for name in known if name not in first]]


def default_scene() -> str:
    """Return the name of the scene that an environment begins with."""
    preferred: str = sailenv_names()["first"] + _SUFFIX
    return preferred if preferred in scenes() else scenes()[0]


def catalog_scene(name: str) -> str:
    """Return the name in tiscene's catalog of a scene.

    Args:
        name: Its name with or without "/scene"; case, spaces, hyphens and underscores do not matter ("room01").

    Raises:
        SceneNotFound: No scene has that name, or more than one scene has it in another spelling.
    """
    exact, known = str(name).strip().removesuffix(_SUFFIX), catalog.scenes()
    if exact in known:
        return exact
    alike = [each for each in known if plain(each) == plain(name)]
    if len(alike) != 1:
        is_file = exact.lower().endswith(catalog.STAGE_SUFFIXES)
        raise SceneNotFound("scene", str(name), scenes(), hint=_OWN_STAGE if is_file else "")
    return alike[0]


def plain(name: str) -> str:
    """Return the name of a scene or a room without the differences that do not matter."""
    text = str(name).strip().casefold().removesuffix(_SUFFIX)
    return "".join(character for character in text if character not in " _-")


def catalog_template(name: str) -> str:
    """Return the name in tiscene's catalog of a template; "Cube Trail" is a cube, since trails are not rendered.

    Raises:
        TemplateNotFound: No template has that name.
    """
    plain = name.strip()
    known = catalog.templates()
    if plain not in known:
        plain = plain.removesuffix(_TRAIL)
    if plain not in known:
        raise TemplateNotFound("template", name, known)
    return plain


def template_scale(name: str) -> Vector3:
    """Return the factors along the axes by which a template of the catalog has SAILenv's size."""
    x, y, z = sailenv_names()["scales"].get(name, (1.0, 1.0, 1.0))
    return (x, y, z)


def spawnable() -> list[str]:
    """Return the names of all templates that can be spawned."""
    known = list(catalog.templates())
    return known + [name + _TRAIL for name in sailenv_names()["trails"] if name in known]


def background(scene: str) -> tuple[int, int, int] | None:
    """Return the 8-bit sRGB color of a catalog scene's background; None for the sky."""
    color = sailenv_names()["backgrounds"].get(scene)
    return None if color is None else (color[0], color[1], color[2])


def template_categories() -> dict[str, str]:
    """Return the category of each template of the catalog by name."""
    return {name: template.category for name, template in catalog.templates().items()}

# SPDX-License-Identifier: Apache-2.0
"""SAILenv's names for scenes and templates. `scenes.json` holds what its scripts rely on."""

from __future__ import annotations

import functools
import json
import warnings
from importlib import resources
from typing import Any

from tiscene import catalog
from tiscene.errors import SceneNotFound, StageWarning, TemplateNotFound
from tiscene.scene.description import Template
from tiscene.usd.read.template import read_template

_SUFFIX = "/scene"
_TRAIL = " Trail"


@functools.cache
def relied_on() -> dict[str, Any]:
    """The contents of `scenes.json`: names by which scripts ask for what may not be there yet."""
    content: dict[str, Any] = json.loads(resources.files(__package__).joinpath("scenes.json").read_text("utf-8"))
    return content


def scenes() -> list[str]:
    """The scenes there are, "object_view/scene" and so on; those that SAILenv has come first, in its order."""
    known = list(catalog.scenes())
    first = [name for name in relied_on()["order"] if name in known]
    return [name + _SUFFIX for name in first + [name for name in known if name not in first]]


def first_scene() -> str:
    """Where a world begins."""
    preferred = relied_on()["first"] + _SUFFIX
    return preferred if preferred in scenes() else scenes()[0]


def scene_of(name: str) -> str:
    """tiscene's name of a scene, with or without "/scene". Raises SceneNotFound."""
    plain = str(name).strip().removesuffix(_SUFFIX)
    if plain not in catalog.scenes():
        raise SceneNotFound("scene", str(name), scenes())
    return plain


def template_of(name: str) -> str:
    """tiscene's name of a template. "Cube Trail" is a cube, for its trail is a matter of display.

    Raises TemplateNotFound.
    """
    plain = name.strip()
    known = catalog.templates()
    if plain not in known:
        plain = plain.removesuffix(_TRAIL)
    if plain not in known:
        raise TemplateNotFound("template", name, known)
    return plain


def spawnable() -> list[str]:
    """What can be spawned, by name."""
    known = list(catalog.templates())
    return known + [name + _TRAIL for name in relied_on()["trails"] if name in known]


@functools.cache
def template_categories() -> dict[str, str]:
    """The category of every template by its name."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said again when it is spawned
        return {name: _read(path).category for name, path in catalog.templates().items()}


def _read(path: Any) -> Template:
    return read_template(path)

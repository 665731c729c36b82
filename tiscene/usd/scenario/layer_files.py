# SPDX-License-Identifier: Apache-2.0
"""layer_file: the files that a scenario on a stage names, found from its layer wherever that is opened."""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Usd

from tiscene import catalog
from tiscene.usd.core.schema import authored


def layer_file(prim: Usd.Prim, name: str) -> str | None:
    """Return the name or file of a scene or a template that an attribute holds, None if it is not authored.

    A file is the one of that name that the layer has as its sublayer, or that the prim refers to, else the one at that
    path from the layer, else from the working directory. The text is kept where it is a path to that file.
    """
    text = authored(prim, name)
    if not text:
        return None
    file, brace, variants = str(text).partition("{")
    if Path(file).suffix.lower() not in catalog.STAGE_SUFFIXES:
        return str(text)
    spec = prim.GetAttribute(name).GetPropertyStack()[0]
    references = [each.assetPath for each in spec.owner.referenceList.GetAddedOrExplicitItems()]
    assets = [asset for asset in [*spec.layer.subLayerPaths, *references] if Path(asset).name == Path(file).name]
    found = next(filter(os.path.isfile, map(spec.layer.ComputeAbsolutePath, [*assets, file])), None)
    if found is None or (os.path.isfile(file) and os.path.samefile(file, found)):
        return str(text)
    return (found if os.path.isabs(file) else _from_here(found)) + brace + variants


def _from_here(file: str) -> str:
    """Return a path relative to the working directory, as the text is; unchanged if it is on another drive."""
    try:
        return Path(os.path.relpath(file)).as_posix()
    except ValueError:
        return file

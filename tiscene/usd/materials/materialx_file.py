# SPDX-License-Identifier: Apache-2.0
"""MaterialX documents (.mtlx) as XML, with the documents that they include."""

from __future__ import annotations

import os
import posixpath
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable

from tiscene.usd.core.package import split_package
from tiscene.usd.materials.image import read_file

_INCLUDE = "{http://www.w3.org/2001/XInclude}include"
_INHERITED = ("colorspace", "fileprefix")  # by the elements inside of one that has them
FILE = "sourceUri"  # attribute of included elements: their own file

Element = ElementTree.Element


def read_document(path: str, allowed: Callable[[str], bool], open_files: tuple[str, ...] = ()) -> Element:
    """Return the root of a document, with the elements of the documents that it includes in their place.

    Args:
        path: of the document.
        allowed: returns whether a file that it includes may be read.
        open_files: the documents that include it.

    Raises:
        ValueError: one of the files is not a MaterialX document, may not be read, or includes itself.
    """
    try:
        root = ElementTree.fromstring(read_file(path))
    except ElementTree.ParseError as error:
        raise ValueError(f"it is not a MaterialX document: {error}") from None
    if root.tag != "materialx":
        raise ValueError(f"it is not a MaterialX document: its root element is <{root.tag}>")
    open_files = (*open_files, path)
    for place in root.findall(_INCLUDE):
        file = anchored(place.get("href", ""), path)
        if file in open_files:
            raise ValueError(f"it includes @{file}@, which includes it")
        if not allowed(file):
            raise ValueError(f"it includes @{file}@, which is outside of the root folder")
        try:
            included = read_document(file, allowed, open_files)
        except (ValueError, OSError) as error:
            raise ValueError(f"it includes @{file}@: {error}") from None
        for each in included:
            for name, value in ((FILE, file), *((name, included.get(name)) for name in _INHERITED)):
                if value is not None and name not in each.attrib:
                    each.set(name, value)
        row = list(root).index(place)
        root[row : row + 1] = list(included)
    return root


def anchored(file: str, document: str) -> str:
    """Return the absolute path of a file that a document names."""
    file = file.replace("\\", "/")
    if os.path.isabs(file) or not file:
        return file
    outer, *inner = split_package(document)
    if inner:
        return f"{outer}[{posixpath.normpath(posixpath.join(posixpath.dirname(inner[-1]), file))}]"
    return os.path.normpath(os.path.join(os.path.dirname(document), file))

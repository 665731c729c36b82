# SPDX-License-Identifier: Apache-2.0
"""Helpers for tests of the USD reader: small stages, expected warnings and problems, mesh measurements."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from tiscene.errors import StageError, StageWarning
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage

STAGES = Path(__file__).parent / "stages"


def write(
    folder: Path, body: str, *, meters: float = 1.0, up: str = "Y", name: str = "stage.usda", more: str = ""
) -> Path:
    """Write a stage file and return its path.

    Args:
        folder: existing folder.
        body: prims, as text.
        meters: metersPerUnit.
        up: upAxis.
        name: file name.
        more: further metadata of the layer, as text.
    """
    path = folder / name
    path.write_text(f'#usda 1.0\n(\n    metersPerUnit = {meters}\n    upAxis = "{up}"\n    {more}\n)\n{body}\n')
    return path


def read(folder: Path, body: str, **header: object) -> SceneDescription:
    """Write and read a stage; further arguments as of `write`."""
    return read_stage(write(folder, body, **header))  # type: ignore[arg-type]


def read_with_warning(folder: Path, body: str, expected: str) -> SceneDescription:
    """Read a stage and check that it gives exactly one StageWarning, which matches a regular expression."""
    path = write(folder, body)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        description = read_stage(path)
    assert [type(w.message) for w in caught] == [StageWarning]
    assert re.search(expected, str(caught[0].message)), str(caught[0].message)
    assert caught[0].filename == __file__
    return description


def problems_of(folder: Path, body: str) -> tuple[str, ...]:
    """Return the problems of a stage that must be refused if read strictly; omissions are ignored."""
    path = write(folder, body)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        with pytest.raises(StageError) as caught:
            read_stage(path, strict=True)
    assert caught.value.stage == str(path)
    return caught.value.problems


def preview_material(path: str, *inputs: str, shaders: str = "") -> str:
    """Return a material with a UsdPreviewSurface as text.

    Args:
        path: its prim path.
        inputs: attributes of the surface.
        shaders: further prims of the material.
    """
    return f"""def Material "{path.rpartition("/")[2]}" {{
    token outputs:surface.connect = <{path}/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        {chr(10).join(inputs)}
        token outputs:surface
    }}
    {shaders}
}}
"""


def primvar_reader(kind: str, name: str, fallback: str = "") -> str:
    """Return the shader "Reader" as text: of a primvar of a type such as "float3"; `fallback` is an attribute."""
    return f"""
    def Shader "Reader" {{
        uniform token info:id = "UsdPrimvarReader_{kind}"
        string inputs:varname = "{name}"
        {fallback}
        {kind} outputs:result
    }}"""


def area(positions: np.ndarray, triangles: np.ndarray) -> float:
    """Return the total area of a mesh."""
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def volume(positions: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume of a closed mesh whose triangles face outwards."""
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def facing(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the unit geometric normals of triangles."""
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    normal = np.cross(b - a, c - a)
    return normal / np.linalg.norm(normal, axis=1)[:, None]


QUAD = """
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
"""

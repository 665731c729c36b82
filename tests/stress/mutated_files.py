# SPDX-License-Identifier: Apache-2.0
"""Row "files": mutated USD, GLB, OBJ, PNG, EXR, HDR and JSON files are read or refused.

Each file is read in a forked process with limits of time and memory. Anything but a TisceneError, and any crash, is a
failure. Stages that could be read are rendered afterwards, all in one process.
"""

from __future__ import annotations

import io
import json
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.stress.child_process import ChildFailed, call
from tests.stress.outcomes import Outcome, count
from tests.usd.damage import READ, REFUSED, STOPPED, crate_bytes, damaged, read_all
from tests.usd.helpers import STAGES

SELF = "tests.stress.mutated_files"
SECONDS = 20.0  # limit for one file
CHUNK = 50  # files per reading process; after a failure the rest of a chunk is not counted
STAGE_SOURCES = ("instances", "scatter", "subsets", "creases", "skinned", "materials")
TOKENS = ("0", "-1", "1e39", "nan", "inf", "-inf", "99999999999999999999", "null", '""', "[]", "{}", "(", "\x00")
VALUES = (0, -1, 1e39, 2**63, True, None, "", "x" * 1000, [], [[]], {}, [0.0] * 100, float("nan"), float("inf"))
PICTURES = (".png", ".exr", ".hdr")
TEXTURED = """#usda 1.0
(
    metersPerUnit = 1
)
def DomeLight "Sky" {
    asset inputs:texture:file = @%s@
}
def Cube "Box" {}
"""


def read_picture_stage(path: str) -> None:
    """Read a stage whose dome light has the picture as its texture."""
    from tiscene.usd.read.stage_reader import read_stage

    with open(os.devnull, "w") as nowhere:  # OpenEXR prints to stdout, which reports the outcomes
        os.dup2(nowhere.fileno(), 1)
    stage = Path(path).with_suffix(".usda")
    stage.write_text(TEXTURED % Path(path).name)
    read_stage(stage)


def import_model(path: str) -> None:
    """Import a model as a template into a folder beside it."""
    from tiscene.usd.importers.import_template import import_asset

    import_asset(path, Path(path).with_suffix(""))


def read_scenario(path: str) -> None:
    """Read a scenario file."""
    from tiscene.scenario.scenario import Scenario

    Scenario.load(path)


READERS = {
    ".usda": "tiscene.usd.read.stage_reader:read_stage",
    ".usdc": "tiscene.usd.read.stage_reader:read_stage",
    ".glb": f"{SELF}:import_model",
    ".obj": f"{SELF}:import_model",
    ".json": f"{SELF}:read_scenario",
} | dict.fromkeys(PICTURES, f"{SELF}:read_picture_stage")


def originals(suffix: str, folder: Path) -> list[bytes]:
    """Return undamaged files of a format, small enough that damage often matters."""
    if suffix in (".usda", ".usdc"):
        texts = [(STAGES / f"{name}.usda").read_text("utf-8") for name in STAGE_SOURCES]
        return [crate_bytes(text, folder, suffix[1:]) for text in texts]
    if suffix in (".glb", ".obj"):
        import trimesh

        meshes = trimesh.creation.icosphere(1), trimesh.creation.box()
        return [_bytes(mesh.export(file_type=suffix[1:])) for mesh in meshes]
    if suffix == ".json":
        from tests.stress.steady_state import scenario

        return [json.dumps(scenario().to_json(), indent=indent).encode() for indent in (None, 1)]
    pixels = np.random.default_rng(1).random((16, 24, 3), dtype=np.float32)
    path = folder / f"picture{suffix}"
    if suffix == ".png":
        from PIL import Image

        buffer = io.BytesIO()
        Image.fromarray((255 * pixels).astype(np.uint8)).save(buffer, "PNG")
        return [buffer.getvalue()]
    if suffix == ".exr":
        import OpenEXR

        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": pixels}).write(str(path))
        return [path.read_bytes()]
    rgbe = np.zeros((16, 24, 4), np.uint8)
    rgbe[..., :3], rgbe[..., 3] = 255 * pixels, 128
    runs = b"".join(b"\x02\x02\x00\x18" + b"".join(b"\x18" + row[:, c].tobytes() for c in range(4)) for row in rgbe)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 24\n"
    return [head + rgbe.tobytes(), head + runs]


def _bytes(data: Any) -> bytes:
    return data if isinstance(data, bytes) else str(data).encode()


def mutated(data: bytes, rng: random.Random, is_text: bool) -> bytes:
    """Return a file with flipped bits; of text, half of the time with values replaced, repeated or removed instead."""
    if not is_text or rng.random() < 0.5:
        return damaged(data, rng)
    words = data.decode().split(" ")
    for _ in range(rng.choice([1, 1, 2, 5])):
        place = rng.randrange(len(words))
        change = rng.randrange(4)
        if change == 0:
            words[place] = rng.choice(TOKENS)
        elif change == 1:
            words[place:place] = words[place : place + 8] * rng.choice([1, 1000])
        elif change == 2:
            del words[place]
        else:
            other = rng.randrange(len(words))
            words[place], words[other] = words[other], words[place]
    return " ".join(words).encode()


def mutated_json(data: bytes, rng: random.Random) -> bytes:
    """Return JSON with 1 to 3 values replaced, removed or renamed."""
    content = json.loads(data)
    for _ in range(rng.randrange(1, 4)):
        place, key = rng.choice(list(_places(content)))
        change = rng.randrange(4)
        if change == 0 or isinstance(place, list):
            place[key] = rng.choice(VALUES)
        elif change == 1:
            del place[key]
        elif change == 2:
            place[f"{key}s"] = place.pop(key)
        else:
            place[key] = [place[key], place[key]]
    return json.dumps(content).encode()


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every container and key of a JSON value."""
    keys = list(content) if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    for key in keys:
        yield content, key
        yield from _places(content[key])


def write_mutated(suffix: str, number: int, folder: Path) -> list[Path]:
    """Write mutated files of a format; their bytes depend on the format and the number alone."""
    rng = random.Random(f"{suffix} {number}")
    sources = originals(suffix, folder)
    paths = [folder / f"mutated_{each}{suffix}" for each in range(number)]
    for number, path in enumerate(paths):
        source = rng.choice(sources)
        if suffix == ".json" and number % 2:
            path.write_bytes(mutated_json(source, rng))
        else:
            path.write_bytes(mutated(source, rng, suffix in (".usda", ".obj", ".json")))
    return paths


def read_mutated(suffix: str, number: int, folder: Path) -> tuple[Outcome, list[Path]]:
    """Read mutated files of a format; return the outcome, and the files that could be read."""
    paths = write_mutated(suffix, number, folder)
    outcomes: list[str] = []
    errors: list[str] = []
    readable: list[Path] = []
    for first in range(0, number, CHUNK):
        chunk = paths[first : first + CHUNK]
        try:
            found = read_all(READERS[suffix], chunk, SECONDS, 60.0 + SECONDS * len(chunk) / 5.0)
        except AssertionError as error:
            errors.append((str(error).strip() or "crash").splitlines()[0])
            continue
        outcomes += found
        readable += [path for path, outcome in zip(chunk, found, strict=True) if outcome == READ]
    counts = {each: outcomes.count(each) for each in (READ, REFUSED, STOPPED)}
    figures = f"{counts[READ]} read, {counts[REFUSED]} refused, {counts[STOPPED]} stopped at {SECONDS:.0f} s"
    if errors:
        figures += f"; {len(errors)} groups of {CHUNK} with another error: {errors[0]}"
    held = not errors and counts[STOPPED] <= max(1, number // 50)
    return Outcome(f"{number} mutated {suffix} files", figures, held), readable


def render_stages(paths: list[str]) -> list[int]:
    """Run in a child process: render the labels of stages; return how many were rendered and how many refused."""
    import tiscene as ts
    from tiscene.errors import TisceneError

    rendered = refused = 0
    for path in paths:
        try:
            with ts.Stream(path, width=16, height=12, buffers=("instance", "depth", "normal")) as stream:
                stream[0]
            rendered += 1
        except TisceneError:
            refused += 1
        except Exception as error:
            raise RuntimeError(f"{Path(path).name}: {error!r}") from error
    return [rendered, refused]


def render_readable(paths: list[Path]) -> Outcome:
    """Render the mutated stages that could be read."""
    use = f"render the {len(paths)} mutated stages that could be read"
    try:
        rendered, refused = call(f"{SELF}:render_stages", [str(path) for path in paths], seconds=60 + 20 * len(paths))
    except ChildFailed as error:
        return Outcome(use, str(error), False)
    return Outcome(use, f"{rendered} rendered, {refused} refused", True)


def rows(scale: float) -> Iterator[Outcome]:
    """Run the row; scale 1 is the full count."""
    with tempfile.TemporaryDirectory(prefix="tiscene-stress-") as name:
        readable = []
        for suffix in READERS:
            folder = Path(name, suffix[1:])
            folder.mkdir()
            outcome, found = read_mutated(suffix, count(1000 / len(READERS), scale, 10), folder)
            yield outcome
            if suffix.startswith(".usd"):
                readable += found
        yield render_readable(readable)

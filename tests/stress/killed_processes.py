# SPDX-License-Identifier: Apache-2.0
"""Row "kills": SIGKILL at random moments of exports, of writing caches and of imports; and processes on one cold cache.

After each kill no file may be torn: a file is absent, or has the bytes that an undisturbed run gives it. A run that
continues afterwards gives the same bytes as an undisturbed one.
"""

from __future__ import annotations

import hashlib
import json
import random
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.stress.child_process import ChildFailed, call, kill_after, result_of, start
from tests.stress.outcomes import Outcome, count
from tiscene.files import LOCK_NAME

HERE = "tests.stress.killed_processes"
READY = "ready"
FRAMES = 24
KILLS_PER_FOLDER = 5
GRID = 160  # vertices along a side of the imported model
IMAGES, IMAGE_SHAPE = 4, (600, 800, 3)
MANIFEST = "tiscene.json"


def export_frames(folder: str) -> list[str]:
    """Run in a child process: export frames, and return the digest of each in the manifest."""
    import tiscene as ts
    from tests.stress.steady_state import SIZE, scenario
    from tiscene.export import export

    stream = ts.Stream(scenario(), quality="fast", base_spp=4, **SIZE)
    stream[0]
    print(READY, flush=True)
    manifest = export(stream, folder, frames=range(FRAMES))
    return [manifest.frames[index]["digest"] for index in range(FRAMES)]


def save_images(folder: str) -> None:
    """Run in a child process: write base images into a cache until killed."""
    from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache

    images, cache = [image(number) for number in range(IMAGES)], BaseImageCache(Path(folder))
    print(READY, flush=True)
    while True:
        for number, each in enumerate(images):
            cache.save(f"{number:064x}", each)


def image(number: int) -> Any:
    """Return a base image, float32 IMAGE_SHAPE, by number."""
    return np.random.default_rng(number).random(IMAGE_SHAPE, dtype=np.float32)


def render_digest() -> str:
    """Run in a child process: return a digest of a frame, in color and with labels."""
    import tiscene as ts
    from tests.stress.steady_state import SIZE, scenario

    print(READY, flush=True)
    frame = ts.Stream(scenario(), quality="fast", base_spp=4, **SIZE)[3]
    return hashlib.sha256(b"".join(frame[name].tobytes() for name in frame.keys())).hexdigest()  # noqa: SIM118


def import_model(model: str, folder: str) -> None:
    """Run in a child process: import a model as a template."""
    from tiscene.usd.importers.import_template import import_asset

    print(READY, flush=True)
    import_asset(model, folder, name="Grid")


def template_digest(folder: str) -> str:
    """Run in a child process: return a digest of a template's meshes and textures, or the error that reading raises."""
    from tiscene.errors import TisceneError
    from tiscene.render.integrators.incremental.base_image_cache import digest_of
    from tiscene.usd.read.template import read_template

    try:
        description = read_template(Path(folder, "template.usda")).description
    except TisceneError as error:
        return f"{type(error).__name__}: {error}"
    return digest_of([description.meshes, description.materials, description.textures]).hex()


def write_model(folder: Path) -> Path:
    """Write an OBJ file of a wavy grid with a texture; return its path."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    lines = ["mtllib grid.mtl", "usemtl wavy"]
    u = np.linspace(0.0, 1.0, GRID)
    for y in u:
        lines += [f"v {x:.4f} {0.05 * np.sin(20.0 * x * y):.4f} {y:.4f}\nvt {x:.4f} {y:.4f}" for x in u]
    for row in range(GRID - 1):
        for column in range(GRID - 1):
            a = row * GRID + column + 1
            corners = (a, a + GRID, a + GRID + 1, a + 1)
            lines.append("f " + " ".join(f"{each}/{each}" for each in corners))
    (folder / "grid.obj").write_text("\n".join(lines) + "\n")
    (folder / "grid.mtl").write_text("newmtl wavy\nKd 1 1 1\nmap_Kd colors.png\n")
    pixels = np.random.default_rng(1).integers(0, 256, (512, 512, 3), np.uint8)
    Image.fromarray(pixels).save(folder / "colors.png")
    return folder / "grid.obj"


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder by relative path, without locks and unfinished temporary files."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != LOCK_NAME and not path.name.endswith(".part")
    }


def torn_files(found: dict[str, bytes], whole: dict[str, bytes]) -> list[str]:
    """Return the names of files that differ from an undisturbed run's. A manifest need only be whole JSON."""
    torn = []
    for name, data in found.items():
        if name == MANIFEST:
            try:
                json.loads(data)
            except ValueError:
                torn.append(name)
        elif whole.get(name) != data:
            torn.append(name)
    return torn


def kill_at_random(rng: random.Random, longest: float, function: str, *arguments: Any, **options: Any) -> bool:
    """Start a function and kill it up to `longest` seconds after it is ready. Return False if it ended before."""
    with start(function, *arguments, **options) as process:
        assert process.stdout is not None
        process.stdout.readline()
        return kill_after(process, rng.uniform(0.0, longest))


def kill_exports(kills: int, folder: Path) -> Outcome:
    """Kill exports, several times in one folder, then let one finish."""
    use = f"SIGKILL at {kills} random moments of exports of {FRAMES} frames, then resume"
    rng, hit, torn, different = random.Random(1), 0, [], 0
    call(f"{HERE}:export_frames", str(folder / "whole"))
    whole = contents(folder / "whole")
    folders = -(-kills // KILLS_PER_FOLDER)
    for number in range(folders):
        output = folder / f"killed_{number}"
        for _ in range(min(KILLS_PER_FOLDER, kills - number * KILLS_PER_FOLDER)):
            hit += kill_at_random(rng, 0.6, f"{HERE}:export_frames", str(output))
            if output.exists():
                torn += torn_files(contents(output), whole)
        call(f"{HERE}:export_frames", str(output))
        different += contents(output) != whole or any(path.name.endswith(".part") for path in output.rglob("*"))
    figures = f"{hit} hit it at work; {len(torn)} torn files; {different} of {folders} resumed folders differ"
    return Outcome(use, figures, hit > 0 and not torn and not different)


def kill_image_writers(kills: int, folder: Path) -> Outcome:
    """Kill a process that writes base images; every image in the cache is whole or absent."""
    from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache

    use = f"SIGKILL at {kills} random moments of writing base images of {4 * int(np.prod(IMAGE_SHAPE)) >> 20} MB"
    rng, wrong, unfinished = random.Random(2), 0, 0
    cache = BaseImageCache(folder)
    for _ in range(kills):
        kill_at_random(rng, 0.3, f"{HERE}:save_images", str(folder))
        unfinished += bool(list(folder.glob(".*.part")))
        for number in range(IMAGES):
            found = cache.load(f"{number:064x}", IMAGE_SHAPE)
            wrong += found is not None and not np.array_equal(found, image(number))
        for path in folder.glob(".*.part"):
            path.unlink()
    return Outcome(use, f"{unfinished} left an unfinished temporary file; {wrong} wrong images", not wrong)


def kill_compilations(kills: int, folder: Path) -> Outcome:
    """Kill processes that fill cold caches, then compare a frame."""
    use = f"SIGKILL at {kills} random moments of compiling into a cold kernel cache and rendering a base image"
    rng, hit, failed = random.Random(3), 0, []
    expected = call(f"{HERE}:render_digest")
    for number in range(-(-kills // KILLS_PER_FOLDER)):
        env = cold_caches(folder / str(number))
        for _ in range(min(KILLS_PER_FOLDER, kills - number * KILLS_PER_FOLDER)):
            hit += kill_at_random(rng, 8.0, f"{HERE}:render_digest", env=env)
        for which in ("first", "second"):
            try:
                if call(f"{HERE}:render_digest", env=env) != expected:
                    failed.append(f"the {which} run after it differs")
            except ChildFailed as error:
                failed.append(str(error))
    return Outcome(use, f"{hit} hit it at work; {len(failed)} wrong {'; '.join(failed[:2])}", hit > 0 and not failed)


def share_cold_cache(processes: int, folder: Path) -> Outcome:
    """Start processes on one cold cache at the same time."""
    use = f"{processes} processes start on one cold kernel and image cache"
    expected = call(f"{HERE}:render_digest")
    env = cold_caches(folder)
    running = [start(f"{HERE}:render_digest", env=env) for _ in range(processes)]
    failed = []
    for process in running:
        try:
            if result_of(process) != expected:
                failed.append("a frame differs")
        except ChildFailed as error:
            failed.append(str(error))
    again = call(f"{HERE}:render_digest", env=env)
    figures = f"{len(failed)} failed {'; '.join(failed[:2])}; a later process gives the same frame: {again == expected}"
    return Outcome(use, figures, not failed and again == expected)


def cold_caches(folder: Path) -> dict[str, str]:
    """Return the environment that places all caches in a folder."""
    return {"TISCENE_CACHE": str(folder / "images"), "TI_OFFLINE_CACHE_FILE_PATH": str(folder / "kernels")}


def kill_imports(kills: int, folder: Path) -> Outcome:
    """Kill imports; what they leave reads as the whole template or raises an error, and a new import repairs it."""
    use = f"SIGKILL at {kills} random moments of importing a model with {2 * (GRID - 1) ** 2:,} triangles"
    rng, hit, torn, different = random.Random(4), 0, [], 0
    model = str(write_model(folder / "model"))
    whole = folder / "whole"
    call(f"{HERE}:import_model", model, str(whole))
    expected, files = call(f"{HERE}:template_digest", str(whole)), contents(whole)
    for number in range(kills):
        output = folder / f"killed_{number}"
        hit += kill_at_random(rng, 2.0, f"{HERE}:import_model", model, str(output))
        if (output / "template.usda").exists():
            found = call(f"{HERE}:template_digest", str(output))
            if found != expected:
                torn.append(found)
        call(f"{HERE}:import_model", model, str(output))
        different += contents(output) != files
    figures = f"{hit} hit it at work; {len(torn)} half templates {torn[:1]}; {different} imports after it differ"
    return Outcome(use, figures, hit > 0 and not torn and not different)


USES: dict[str, tuple[Callable[[int, Path], Outcome], int]] = {
    "exports": (kill_exports, 50),
    "images": (kill_image_writers, 20),
    "kernels": (kill_compilations, 20),
    "shared": (share_cold_cache, 2),
    "imports": (kill_imports, 20),
}


def rows(scale: float, use: str | None = None) -> Iterator[Outcome]:
    """Run the row, or one of USES; scale 1 is the full count."""
    for name in USES if use is None else (use,):
        run, full = USES[name]
        repetitions = full if run is share_cold_cache else count(full, scale)
        with tempfile.TemporaryDirectory(prefix="tiscene-stress-") as folder:
            yield run(repetitions, Path(folder))

# SPDX-License-Identifier: Apache-2.0
"""The parts of `python -m tests.gpu`: each yields lines of results and never stops at a failure.

A part takes the baked scenes and `scale`, the fraction of the full work; 1 is meant for a GPU, the default on a CPU is
less. Of the risks that a part looks for, see the docstrings.
"""

from __future__ import annotations

import itertools
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tests.gpu.baked_scene import LABEL_SIZE, LABELS, SPHERE, BakedScene
from tests.gpu.batch_parts import SIZE, TIME, TIMED, batch, batch_colors, serial
from tests.gpu.checks import Check, median
from tests.gpu.stream_parts import streams
from tiscene.device import runtime
from tiscene.device.memory import device_array, upload, upload_vectors
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.intersect.ray_queue import hit, hit_id
from tiscene.render.intersect.trace import closest
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

INTEGERS = ("semantic", "instance", "part")
MAX_LISTED = 8  # pixels of a line
SILHOUETTE = 1e-4  # fraction of pixels that may show another object than on the CPU


def environment(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Versions, and the device that Taichi runs on."""
    yield Check("machine", f"{platform.machine()}, {os.cpu_count()} logical cores, Python {platform.python_version()}")
    yield Check("packages", f"taichi {'.'.join(map(str, ti.__version__))}, numpy {np.__version__}")
    yield Check("backend", str(runtime.running()), runtime.running() is not None)
    if shutil.which("nvidia-smi"):
        query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
        yield Check("device", subprocess.run(query, capture_output=True, text=True, check=False).stdout.strip())
    for scene in scenes:
        count = sum(len(mesh.triangles) for mesh in scene.description.meshes)
        yield Check(scene.name, f"{count:,} triangles, {len(scene.placements[0].mesh)} instances")


def labels(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Labels as on the CPU: integers but for silhouettes, floats where both show the same surface."""
    for scene in scenes:
        found = scene.render_labels(scene.device_scene())
        same = np.ones(LABEL_SIZE[::-1], bool)
        for name in INTEGERS:
            differs = found[name] != scene.labels[name]
            same &= ~differs
            where = [
                f"({x}, {y}) {found[name][y, x]} for {scene.labels[name][y, x]} at {scene.labels['depth'][y, x]:.3f} m"
                for y, x in np.argwhere(differs)[:MAX_LISTED]
            ]
            text = ", ".join([f"{differs.mean():.1e} of pixels differ", *where])
            yield Check(f"{scene.name}: {name}", text, bool(differs.mean() <= SILHOUETTE))
        for name in LABELS:
            if name not in INTEGERS:
                ours, theirs = found[name][same], scene.labels[name][same]
                finite = np.isfinite(theirs)
                error = np.abs(np.where(finite, ours, 0.0) - np.where(finite, theirs, 0.0)) / (
                    1.0 + np.abs(np.where(finite, theirs, 0.0))
                )
                share = float((error > 1e-4).mean()) if error.size else 0.0
                text = f"largest relative difference {error.max(initial=0.0):.1e}, above 1e-4 in {share:.1e}"
                yield Check(f"{scene.name}: {name}", text, share <= 1e-3 and np.array_equal(np.isfinite(ours), finite))


def watertight(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Rays from inside a closed sphere at its edges and corners: none may miss (risk 1, fused multiply-add)."""
    scene = next(each for each in scenes if each.name == SPHERE)
    device, mesh = scene.device_scene(), scene.description.meshes[0]
    random = np.random.default_rng(5)
    chunk, misses, total = 1 << 20, 0, int(1e8 * scale)
    hits, hit_ids, queue = device_array(hit, chunk), device_array(hit_id, chunk), upload(np.arange(chunk))
    for _ in range(-(-total // chunk)):
        corners = mesh.positions[mesh.triangles[random.integers(len(mesh.triangles), size=chunk)]]
        along = np.where(random.random(chunk) < 0.2, 0.0, random.random(chunk))[:, None].astype(np.float32)
        targets = corners[:, 0] * (1.0 - along) + corners[:, 1] * along
        rays = np.zeros((chunk, 8), np.float32)
        rays[:, :3] = random.uniform(-0.5, 0.5, (chunk, 3))
        directions = targets - rays[:, :3]
        rays[:, 4:7] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        rays[:, 7] = np.inf
        closest(device, CURRENT, upload_vectors(rays), queue, chunk, hits, hit_ids)
        misses += int((hit_ids.to_numpy()[:, 0] < 0).sum())
    yield Check("rays at edges of a closed sphere", f"{misses} of {-(-total // chunk) * chunk:,} miss", misses == 0)


def path(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Path-traced radiance: mean, and z-scores of tiles against the CPU's two images."""
    for scene in scenes:
        found = scene.render_radiance(scene.device_scene(), seed=3)
        expected = scene.radiance.mean(axis=0)
        ratio = float(found.mean() / expected.mean())
        yield Check(f"{scene.name}: mean radiance over the CPU's", f"{ratio:.4f}", abs(ratio - 1.0) < 0.02)
        # Rare bright samples would decide alone: pixels are compared up to four times the mean.
        limit = 4.0 * expected.mean()
        found, first, second = (np.minimum(each, limit) for each in (found, *scene.radiance))
        tiles = _tiles(found - 0.5 * (first + second))
        # Each half has the noise of one rendering: their difference has variance 2 s², that of found - expected 1.5 s².
        deviation = np.sqrt(0.75 * np.mean(_tiles(first - second) ** 2))
        z = float(np.sqrt(np.mean(tiles**2)) / max(deviation, 1e-12))
        yield Check(f"{scene.name}: root mean square z-score of tiles", f"{z:.2f}", z < 1.5)


def incremental(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Incremental rendering: the mean of a frame with movers, against path tracing on the same device."""
    for scene in scenes:
        if scene.moving.any():
            device, view = scene.device_scene(), scene.view((48, 36))
            renderer = IncrementalPass(PathPass(device, 48, 36))
            renderer.prepare(view, scene.placements[1], scene.moving, seed=1, spp=16, max_depth=6, base_spp=256)
            device.place(scene.placements[1])
            image = renderer.render(scene.moving).hdr
            traced = PathPass(device, 48, 36).render(view, frame_index=1, seed=9, spp=256, max_depth=6).hdr
            ratio = float(image.mean() / traced.mean())
            yield Check(f"{scene.name}: mean over path tracing's", f"{ratio:.4f}", abs(ratio - 1.0) < 0.03)


def repeat(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Same bytes from run to run (risks 8 and 9, order of lists and of sums)."""
    runs = max(2, int(20 * scale))
    for scene in scenes:
        device = scene.device_scene()
        first_labels, first_light = scene.render_labels(device), scene.render_radiance(device, 4, 4)
        same = 0
        for _ in range(runs):
            again = scene.render_labels(device)
            same += all(again[name].tobytes() == first_labels[name].tobytes() for name in LABELS) and (
                scene.render_radiance(device, 4, 4).tobytes() == first_light.tobytes()
            )
        yield Check(f"{scene.name}: runs with the same bytes", f"{same} of {runs}", same == runs)


def motion(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Bounding volume hierarchies of moved instances: labels of later frames are those of a scene placed anew."""
    for scene in scenes:
        device = scene.device_scene()
        for frame, placement in enumerate(scene.placements[1:4], start=1):
            device.place(placement, times=TIME)
            refitted = LabelPass(device).render(scene.view(LABEL_SIZE), LABELS)
            new = DeviceScene()
            new.add(scene.description)
            new.place(placement, times=TIME)
            built = LabelPass(new).render(scene.view(LABEL_SIZE), LABELS)
            same = all(refitted[name].tobytes() == built[name].tobytes() for name in LABELS)
            yield Check(f"{scene.name}: frame {frame} as placed anew", "same bytes" if same else "differs", same)


def denoiser(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """The denoiser on the card (risk 12): the picture is nearer to the mean of many samples, and how long it takes."""
    try:
        import pyoidn  # noqa: F401
    except ImportError:
        yield Check("Open Image Denoise", "not installed")
        return
    from tiscene.render.film.denoise import denoise, denoiser_device

    yield Check("device", denoiser_device(), denoiser_device() == runtime.running())
    random = np.random.default_rng(4)
    for scene in scenes:
        clean = scene.radiance.mean(axis=0)
        guides = np.full_like(clean, 0.5), np.zeros_like(clean)
        noisy = (clean * random.gamma(2.0, 0.5, clean.shape[:2])[..., None]).astype(np.float32)
        result = denoise(noisy, *guides, clean=False)
        limit = 4.0 * clean.mean()
        before, after = (
            float(np.mean((np.minimum(e, limit) - np.minimum(clean, limit)) ** 2)) for e in (noisy, result)
        )
        same = result.tobytes() == denoise(noisy, *guides, clean=False).tobytes()
        text = f"{after / max(before, 1e-12):.2f} of the noisy picture's"
        yield Check(f"{scene.name}: squared error", text, bool(after < before) and same)
    image = [np.ones((*SIZE[::-1], 3), np.float32)] * 3
    for quality in ("fast", "balanced", "high"):
        seconds = median(partial(denoise, *image, quality), 5)
        yield Check(f"256x192, {quality}", f"{1e3 * seconds:.1f} ms")


def memory(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Memory of the process after scenes were made and dropped many times."""
    scene, used = scenes[0], []
    for _ in range(max(4, int(20 * scale))):
        device = scene.device_scene()
        scene.render_labels(device)
        del device
        used.append(_resident_megabytes())
    growth = used[-1] - used[len(used) // 2]
    text = f"{used[0]:.0f} MB at first, {used[-1]:.0f} MB after {len(used)} scenes"
    yield Check("memory of the host", text, growth < 0.1 * used[-1])


def patches(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Same bytes with tiscene's launches and copies and with Taichi's own (risk 7)."""
    program = (
        "import hashlib, sys; from pathlib import Path\n"
        "from tests.gpu.baked_scene import load\nfrom tiscene.device import runtime\n"
        "runtime.start(sys.argv[1])\n"
        "for s in load(Path(sys.argv[2])):\n"
        "    d = s.device_scene(); l = s.render_labels(d); r = s.render_radiance(d, 5, 4)\n"
        "    print(s.name, hashlib.sha256(b''.join(v.tobytes() for v in [*l.values(), r])).hexdigest())\n"
    )
    digests = {}
    for switch in ("", "0", "1"):
        command = [sys.executable, "-c", program, str(runtime.running()), os.environ["TISCENE_GPU_SCENES"]]
        environment = {**os.environ, "TISCENE_TAICHI_PATCHES": switch}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        digests[switch] = [line for line in done.stdout.splitlines() if line.startswith(tuple(s.name for s in scenes))]
        if done.returncode:
            yield Check(
                f"TISCENE_TAICHI_PATCHES={switch}", (done.stderr.strip() or "no output").splitlines()[-1], False
            )
    same = digests[""] == digests["0"] and len(digests[""]) == len(scenes)
    yield Check("digests with patches on and off", "equal" if same else "differ", same)
    # The compiler may order sums otherwise where the front end leaves out steps: no failure on a card.
    fused = digests["1"] == digests["0"]
    yield Check("digests with the patched front end too", "equal" if fused else "differ")


def speed(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Milliseconds per frame and rays per second, medians; the goals are for an H200."""
    for scene in scenes:
        device, view = scene.device_scene(), scene.view(SIZE)
        passes, count = LabelPass(device), itertools.count()
        # A camera that turns, since labels of a resting view are kept.
        time_labels = median(lambda: passes.render(scene.view(SIZE, turned=0.02 * next(count)), TIMED))  # noqa: B023
        yield Check(f"{scene.name}: labels, 256x192", f"{1e3 * time_labels:.1f} ms (goal: 2 ms)")
        if len(scene.placements) > 1:
            placements = itertools.cycle(scene.placements)
            time_placing = median(lambda: device.place(next(placements)))  # noqa: B023
            yield Check(f"{scene.name}: place instances", f"{1e3 * time_placing:.2f} ms")
        paths = PathPass(device, *SIZE)
        trace = partial(paths.render, view, frame_index=0, seed=1, spp=4, max_depth=6)
        yield Check(f"{scene.name}: 4 spp, 256x192", f"{1e3 * median(trace, 5):.0f} ms (goal with denoiser: 17 ms)")
        yield Check(f"{scene.name}: incoherent rays", f"{_incoherent_rays(scene, device):.1f} M/s (goal: 300 M/s)")


def compile_times(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """First frame in a new process, with Taichi's cache as it is, and emptied (risk 5)."""
    program = (
        "import sys, time; from pathlib import Path; began = time.perf_counter()\n"
        "from tests.gpu.baked_scene import load\nfrom tiscene.device import runtime\n"
        "runtime.start(sys.argv[1]); s = load(Path(sys.argv[2]))[0]; d = s.device_scene()\n"
        "s.render_labels(d); labels = time.perf_counter() - began\n"
        "s.render_radiance(d, 1, 1); print(f'labels {labels:.1f} s, colors {time.perf_counter() - began:.1f} s')\n"
    )
    for name, cache in (("warm", {}), ("cold", {"TI_OFFLINE_CACHE": "0"})):
        command = [sys.executable, "-c", program, str(runtime.running()), os.environ["TISCENE_GPU_SCENES"]]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **cache})
        lines = (done.stdout.strip() or done.stderr.strip() or "no output").splitlines()
        yield Check(f"first frame, {name} kernel cache", lines[-1], done.returncode == 0)


Part = Callable[[list[BakedScene], float], Iterator[Check]]
PARTS: dict[str, tuple[Part, int]] = {  # with the limit of time, s
    "environment": (environment, 60),
    "labels": (labels, 120),
    "watertight": (watertight, 180),
    "path": (path, 240),
    "incremental": (incremental, 240),
    "repeat": (repeat, 240),
    "motion": (motion, 120),
    "batch": (batch, 180),
    "colors": (batch_colors, 240),
    "serial": (serial, 120),
    "denoiser": (denoiser, 120),
    "memory": (memory, 180),
    "patches": (patches, 400),
    "speed": (speed, 240),
    "streams": (streams, 300),
    "compile": (compile_times, 400),
}


def _tiles(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return means over tiles of 6x6 pixels."""
    height, width, channels = image.shape
    return image.astype(np.float64).reshape(height // 6, 6, width // 6, 6, channels).mean(axis=(1, 3))


def _incoherent_rays(scene: BakedScene, device: DeviceScene) -> float:
    """Return closest hits per second of rays in random directions from random points of the room, in millions."""
    random = np.random.default_rng(2)
    count = 1 << 18
    rays = np.zeros((count, 8), np.float32)
    rays[:, :3] = np.array(scene.camera.position) + random.uniform(-0.5, 0.5, (count, 3))
    directions = random.normal(size=(count, 3))
    rays[:, 4:7] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rays[:, 7] = np.inf
    on_device, queue = upload_vectors(rays), upload(np.arange(count))
    hits, hit_ids = device_array(hit, count), device_array(hit_id, count)
    return count / median(lambda: closest(device, CURRENT, on_device, queue, count, hits, hit_ids), 10) / 1e6


def _resident_megabytes() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

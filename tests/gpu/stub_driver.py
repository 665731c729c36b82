# SPDX-License-Identifier: Apache-2.0
"""A CUDA driver that needs no card: kernels are compiled for one, and launched, but do nothing.

It shows whether all kernels compile, what they are launched with, and what the host spends on a frame: `python -m
tests.gpu.stub_driver SCENES` prints the time of the host, for the frames whose time `python -m tests.gpu speed` takes
on a card. Needs a C compiler.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SOURCE = Path(__file__).with_suffix(".c")


def compiler() -> str | None:
    """Return the path of a C compiler; None if there is none, or this is not Linux."""
    return (shutil.which("cc") or shutil.which("gcc")) if sys.platform == "linux" else None


def build(folder: Path) -> dict[str, str]:
    """Compile the driver into a folder; return the environment in which Taichi finds it, without offline cache."""
    command = [str(compiler()), "-O1", "-shared", "-fPIC", "-w", str(SOURCE), "-o", str(folder / "libcuda.so")]
    subprocess.run(command, check=True)
    shutil.copy(folder / "libcuda.so", folder / "libcuda.so.1")
    return {**os.environ, "LD_LIBRARY_PATH": str(folder), "TI_OFFLINE_CACHE": "0", "TISCENE_ARCH": "cuda"}


def without_trees() -> None:
    """Make scenes without the trees of meshes, which kernels that do nothing cannot build."""
    from tiscene.scene.bvh import binary_trees
    from tiscene.scene.bvh.instance_tree import empty_nodes

    def numbered_nodes(
        node_box: NDArray[np.float32], node_link: NDArray[np.int32], roots: NDArray[np.integer]
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        ends = np.arange(1, len(roots) + 1, dtype=np.int32)
        return empty_nodes(len(roots)), np.stack([ends, ends, 0 * ends], axis=1)

    binary_trees.LARGE = 1 << 30
    binary_trees.numbered_nodes = numbered_nodes


def render(folder: Path, colors: bool) -> None:
    """Render labels, and colors if wanted, of the baked scenes in a folder, with and without what moves."""
    from tests.gpu.baked_scene import load
    from tiscene.device import runtime
    from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

    without_trees()
    runtime.start("cuda")
    for scene in load(folder):
        device = scene.device_scene()
        for placement in scene.placements[:2]:
            device.place(placement, times=(PREVIOUS, CURRENT, NEXT))
            for _ in range(2):
                scene.render_labels(device)
            if colors:
                scene.render_radiance(device, seed=1, spp=1)


def times(folder: Path) -> None:
    """Print the host's milliseconds per frame of the baked scenes in a folder."""
    from tests.gpu.baked_scene import load
    from tests.gpu.batch_parts import SIZE, TIME, TIMED
    from tests.gpu.checks import median
    from tiscene.device import runtime
    from tiscene.render.integrators.labels.label_pass import LabelPass

    without_trees()
    runtime.start("cuda")
    for scene in load(folder):
        device, frames = scene.device_scene(), count()
        single, stacked = LabelPass(device), LabelPass(scene.device_scene())
        placements = [scene.placements[frame % len(scene.placements)] for frame in range(16)]

        def label() -> None:
            single.render(scene.view(SIZE, turned=0.02 * next(frames)), TIMED)  # noqa: B023

        def place() -> None:
            device.place(placements[next(frames) % 16], times=TIME)  # noqa: B023

        def batch() -> None:
            views = [scene.view(SIZE, turned=0.02 * next(frames)) for _ in placements]  # noqa: B023
            stacked.render_frames(views, placements, TIMED)  # noqa: B023

        parts: dict[str, tuple[Callable[[], None], int]] = {
            "labels": (label, 1),
            "instances placed": (place, 1),
            "labels, 16 frames at once": (batch, 16),
        }
        for name, (work, number) in parts.items():
            print(f"{scene.name}: {name}: {1e3 * median(work) / number:.2f} ms a frame on the host", flush=True)


if __name__ == "__main__":
    if os.environ.get("TISCENE_ARCH") == "cuda":
        times(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as made:
            command = [sys.executable, "-m", "tests.gpu.stub_driver", *sys.argv[1:]]
            sys.exit(subprocess.run(command, env=build(Path(made)), check=False).returncode)

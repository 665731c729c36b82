# SPDX-License-Identifier: Apache-2.0
"""The path pass gives the same bytes in any process, with any number of threads and in batches of any size."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from tests.render.path_scenes import (
    BOX_CAMERA,
    CEILING_LAMP,
    CORNELL,
    WHITE,
    ball,
    box,
    described,
    device_scene,
    lit_box,
    render,
)
from tiscene.render.integrators.path import path_scene
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.scene.description import DomeLight, Material


def digest(image: np.ndarray) -> str:
    """Return the SHA-256 of an image."""
    return hashlib.sha256(image.tobytes()).hexdigest()


def fingerprint() -> str:
    """Return digests of images with glass, textures of light and many bounces; other processes run this too."""
    meshes, materials = box(CORNELL)
    meshes.append(ball((0.3, 0.3, 0.2), 0.4, 3))
    materials.append(Material("frosted", opacity=0.2, roughness=0.3, clearcoat=0.5))
    sky = DomeLight("sky", "/sky", np.eye(4), WHITE)
    image = render(
        described(meshes, materials, [CEILING_LAMP, sky]), BOX_CAMERA, (40, 30), spp=6, max_depth=8, frame_index=3
    )
    return digest(image.hdr) + digest(image.albedo) + digest(image.normal)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        "runtime.start(threads=1)",
        "runtime.start(threads=2)",
        "PathPass.vector_mode = lambda _: contextlib.nullcontext()",
    ],
)
def test_same_bytes_in_another_process(change: str) -> None:
    """With other numbers of threads, and with kernels compiled in scalar instead of vector mode."""
    code = (
        "import contextlib\n"
        "from tiscene.device import runtime\n"
        "from tiscene.render.integrators.path.path_pass import PathPass\n"
        f"{change}\n"
        "from tests.render.integrators.path.test_repeatability import fingerprint; print(fingerprint())"
    )
    result = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True)
    assert (result.returncode, result.stderr[-3000:]) == (0, "")
    assert result.stdout.split() == [fingerprint()]


def test_bytes_do_not_depend_on_batch_size() -> None:
    scene = device_scene(lit_box())
    whole = render(scene, BOX_CAMERA, (20, 13), spp=5)
    for batch_size in (128, 1000, 1300):
        parts = render(scene, BOX_CAMERA, (20, 13), spp=5, batch_size=batch_size)
        assert digest(parts.hdr) == digest(whole.hdr)
        assert digest(parts.albedo) == digest(whole.albedo)


@pytest.mark.parametrize("kind", ["glass", "emissive", "passable"])
def test_bytes_do_not_depend_on_how_many_segments_a_launch_traces(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes, materials = box(CORNELL)
    meshes.append(ball((0.3, 0.3, 0.2), 0.4, 3))
    looks = {
        "glass": {"opacity": 0.2, "roughness": 0.3, "clearcoat": 0.5},
        "emissive": {"emissive_color": (3.0, 2.0, 1.0)},
        "passable": {"opacity": 0.5, "opacity_mode": "presence"},
    }
    materials.append(Material("ball", **looks[kind]))
    sky = DomeLight("sky", "/sky", np.eye(4), WHITE)
    scene = device_scene(described(meshes, materials, [CEILING_LAMP, sky]))
    advance, launches = PathPass.advance, []
    monkeypatch.setattr(PathPass, "advance", lambda *args: launches.append(args[-1]) or advance(*args))
    images = []
    for few in (0, 200, 1 << 20):
        monkeypatch.setattr(path_scene, "FEW_PATHS", few)
        images.append(render(scene, BOX_CAMERA, (20, 13), spp=5, max_depth=8))
        images[-1] = digest(images[-1].hdr), digest(images[-1].albedo), digest(images[-1].normal)
        together = kind != "passable" and scene.traversal == "bvh8"
        assert few == 200 or max(launches) == (7 if few and together else 1)
        launches.clear()
    assert set(images) == {images[0]}


def test_frames_and_seeds_have_independent_noise() -> None:
    scene = device_scene(lit_box())
    first = render(scene, BOX_CAMERA, spp=4).hdr
    assert digest(render(scene, BOX_CAMERA, spp=4).hdr) == digest(first)
    for other in ({"seed": 2}, {"frame_index": 1}):
        image = render(scene, BOX_CAMERA, spp=4, **other).hdr
        assert np.abs(image - first).max() > 1e-3
        assert image.mean() == pytest.approx(first.mean(), rel=0.25)

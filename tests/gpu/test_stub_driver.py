# SPDX-License-Identifier: Apache-2.0
"""Without a card: kernels compile for CUDA, and are launched with the arguments that Taichi's own launches have."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.gpu import bake, stub_driver
from tests.gpu.baked_scene import SPHERE
from tests.gpu.stub_driver import compiler

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(compiler() is None, reason="a CUDA driver without a card needs a C compiler, on Linux"),
]
PROGRAM = "import sys; from pathlib import Path; from tests.gpu.stub_driver import render; "


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    bake._still(SPHERE, bake.sphere()).save(folder)
    return folder


def run(scenes: Path, folder: Path, colors: bool, **variables: str) -> None:
    environment = stub_driver.build(folder) | variables
    command = [sys.executable, "-c", PROGRAM + f"render(Path(sys.argv[1]), {colors})", str(scenes)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def launches(log: Path) -> list[str]:
    """Return the launches of this project's kernels.

    Taichi's own copy arrays. Numbers of kernels, which depend on what was compiled before, are left out.
    """
    lines = [re.sub(r"_c\d+_\d+_kernel", "_kernel", line) for line in log.read_text().splitlines()]
    return [line for line in lines if "_kernel" in line and not line.startswith(("ext_arr", "ndarray_to", "fill_"))]


def test_direct_launches_have_the_arguments_of_taichis_own(scenes, tmp_path):
    logs = []
    for switch in ("0", ""):
        log = tmp_path / f"log{switch}"
        run(scenes, tmp_path, False, STUB_LOG=str(log), TISCENE_TAICHI_PATCHES=switch)
        logs.append(launches(log))
    taichis, direct = logs
    assert any(line.startswith("surface_labels") for line in direct)
    assert len(direct) > 20
    assert direct == taichis


def test_kernels_compile_for_a_card(scenes, tmp_path):
    run(scenes, tmp_path, True, STUB_PTX=str(tmp_path))
    code = "".join(file.read_text() for file in tmp_path.glob("*.ptx"))
    kernels = set(re.findall(r"\.entry (\w+?)_c\d+_\d+_kernel_\d", code))
    assert {"closest", "shade", "compact_queue", "surface_labels", "develop"} <= kernels
    assert "fma.rn.f32" not in code.split(".entry closest")[1].split(".entry")[0]


def test_time_of_the_host_is_printed(scenes, tmp_path):
    command = [sys.executable, "-m", "tests.gpu.stub_driver", str(scenes)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert [line.rpartition(":")[0] for line in lines] == [
        "sphere: labels",
        "sphere: instances placed",
        "sphere: labels, 16 frames at once",
    ]

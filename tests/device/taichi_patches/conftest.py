# SPDX-License-Identifier: Apache-2.0
"""The tests of the patches are skipped where the patches are off."""

import pytest
import taichi as ti

from tiscene.device import runtime
from tiscene.device.taichi_patches import ast_recorder, fence


@pytest.fixture(autouse=True)
def patches() -> None:
    if not fence.enabled():
        pytest.skip(f"{fence.SWITCH}=0")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder of recordings."""
    runtime.start()
    monkeypatch.setattr(ti.cfg, "offline_cache_file_path", str(tmp_path))
    return tmp_path / ast_recorder.FOLDER

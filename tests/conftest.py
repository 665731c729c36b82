# SPDX-License-Identifier: Apache-2.0
"""One Taichi start and one cache folder for the whole session."""

import os

import pytest

from tiscene.device import runtime


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Other processes that a test starts find it too."""
    os.environ["TISCENE_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session", autouse=True)
def taichi() -> str:
    return runtime.start(threads=2)

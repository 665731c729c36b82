"""One Taichi start for the whole session."""

import pytest

from tiscene import device


@pytest.fixture(scope="session", autouse=True)
def taichi() -> str:
    return device.start(threads=2)

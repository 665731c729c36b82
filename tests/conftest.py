# SPDX-License-Identifier: Apache-2.0
"""One Taichi runtime and one cache folder for the whole session."""

import gc
import os
import signal

import pytest

from tiscene.device import runtime
from tiscene.device.taichi_patches import fence

gc.disable()  # until all tests are collected
fence.include("tests")  # before test modules, and the kernels in them, are imported

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in the background of a shell; what tests start would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """End the tests if a worker crashes: with `--dist loadfile`, pytest-xdist 3.8 would replace it and then wait."""
    if getattr(config.option, "maxworkerrestart", "0") is None:
        config.option.maxworkerrestart = "0"


def pytest_collection_finish() -> None:
    """Leave what has been collected out of garbage collections, each of which would take a second."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_unconfigure() -> None:
    """Let the garbage collector find Taichi's program when Python ends: it then saves the kernels that it compiled."""
    gc.unfreeze()


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Set the folder of the base image cache, for subprocesses too."""
    os.environ["TISCENE_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session", autouse=True)
def taichi() -> str:
    return runtime.start(threads=2)

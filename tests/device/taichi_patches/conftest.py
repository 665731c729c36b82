# SPDX-License-Identifier: Apache-2.0
"""The tests of the patches are skipped where the patches are off."""

import pytest

from tiscene.device.taichi_patches import fence


@pytest.fixture(autouse=True)
def patches() -> None:
    if not fence.enabled():
        pytest.skip(f"{fence.SWITCH}=0")

# SPDX-License-Identifier: Apache-2.0
"""Peers to measure against, as far as they are installed."""

from __future__ import annotations

import sys
from typing import Any


def mitsuba(variant: str = "llvm_ad_rgb") -> Any | None:
    """The module with that variant set; None, and a line that says so, where it cannot be had."""
    try:
        import mitsuba as mi

        mi.set_variant(variant)
    except ImportError as error:
        print(f"Mitsuba's lines are left out: {error}. pip install -e '.[benchmark]' has it.", file=sys.stderr)
        return None
    return mi

# SPDX-License-Identifier: Apache-2.0
"""Other renderers to compare with, if they are installed."""

from __future__ import annotations

import sys
from typing import Any


def mitsuba(variant: str = "llvm_ad_rgb") -> Any | None:
    """Return Mitsuba's module with a variant set; None, with a message, if it is not installed."""
    try:
        import mitsuba as mi

        mi.set_variant(variant)
    except ImportError as error:
        print(f"Mitsuba's lines are omitted: {error}. Install it: pip install -e '.[benchmark]'", file=sys.stderr)
        return None
    return mi

# SPDX-License-Identifier: Apache-2.0
"""content_digest: equal arrays and values have one key, so that they are read once and shared."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np


def content_digest(values: Iterable[Any]) -> bytes:
    """Return a digest of values: of arrays by their bytes, of others by their `repr`."""
    digest = hashlib.blake2b(digest_size=16)
    for each in values:
        digest.update(np.ascontiguousarray(each).data if isinstance(each, np.ndarray) else repr(each).encode())
        digest.update(b"|")
    return digest.digest()

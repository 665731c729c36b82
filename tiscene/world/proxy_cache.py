# SPDX-License-Identifier: Apache-2.0
"""Sphere proxies that this process has made last: worlds with the same objects share them."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from dynamics import Shape, cover
from dynamics.lru_cache import LRUCache

MAX_PROXIES = 1024  # about 5 kB each

_proxies: LRUCache[bytes, Shape] = LRUCache(MAX_PROXIES)  # by the digest of the surface


def proxy_of(surface: NDArray[np.float64]) -> Shape:
    """Return `dynamics.cover` of a surface, float64 [m, 3, 3], m. Taichi must be running."""
    key = hashlib.sha256(np.ascontiguousarray(surface, np.float64).data).digest()
    return _proxies.get(key, lambda: _new_proxy(surface))


def _new_proxy(surface: NDArray[np.float64]) -> Shape:
    shape = cover(surface)
    for array in (shape.spheres, shape.groups, shape.first):
        array.setflags(write=False)
    return shape

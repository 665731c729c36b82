# SPDX-License-Identifier: Apache-2.0
"""Streams of small stages with time samples."""

from __future__ import annotations

import warnings

import tiscene as ts
from tests.usd.helpers import QUAD

RANGE = "startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10"
SQUARE = QUAD.replace("(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)", "(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)")


def stream(path, **others):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera = ts.Camera(position=(0.0, 0.0, 6.0), exposure=0.0)
        options = {"width": 16, "height": 12, "fps": 10.0, "camera": camera, "spp": 4, "denoise": False} | others
        return ts.Stream(path, **options)

# SPDX-License-Identifier: Apache-2.0
"""Color space metadata of image files: the transfer function that PNG chunks or an ICC profile declare.

UsdUVTexture's sourceColorSpace "auto" follows such metadata and otherwise guesses from the number of bits and channels.
Only the transfer function counts; primaries are not converted.
"""

from __future__ import annotations

import struct
from typing import Literal

Transfer = Literal["srgb", "linear"]

_HEADER_SIZE = 128  # of an ICC profile; the tag table follows
_CURVES = (b"gTRC", b"kTRC")  # tone curves of green and of gray
_SRGB_HALF = 0.2140  # linear value of 0.5 in sRGB; gamma 2.2 has 0.2176
_TOLERANCE = 0.02


def declared_transfer(
    *, profile: bytes | None = None, has_srgb_chunk: bool = False, gamma: float | None = None
) -> Transfer | None:
    """Return the transfer function that a file declares; None if it declares none, or another one.

    Args:
        profile: an ICC profile; takes precedence over the others, as the PNG specification says.
        has_srgb_chunk: whether a PNG has the chunk sRGB; takes precedence over `gamma`.
        gamma: exponent of a PNG's chunk gAMA, such as 0.45455; None if it has none.
    """
    if profile is not None:
        return _profile_transfer(profile)
    if has_srgb_chunk:
        return "srgb"
    return None if gamma is None or gamma <= 0.0 else _classify(0.5 ** (1.0 / gamma))


def _classify(half: float | None) -> Transfer | None:
    """Return the transfer function that maps 0.5 to the linear value `half`."""
    if half is None:
        return None
    if abs(half - _SRGB_HALF) < _TOLERANCE:
        return "srgb"
    return "linear" if abs(half - 0.5) < _TOLERANCE else None


def _profile_transfer(profile: bytes) -> Transfer | None:
    """Return the transfer function of an ICC profile; one of lookup tables is known by its description alone."""
    try:
        tags = _tags(profile)
        curves = [_curve_at_half(tags[name]) for name in _CURVES if name in tags]
    except (struct.error, ArithmeticError, TypeError, ValueError):
        return None  # a damaged profile says nothing
    if curves:
        return _classify(curves[0])
    description = tags.get(b"desc", b"")
    return "srgb" if b"srgb" in description.replace(b"\0", b"").lower() else None


def _tags(profile: bytes) -> dict[bytes, bytes]:
    """Return the contents of a profile's tags by their signatures."""
    (count,) = struct.unpack_from(">I", profile, _HEADER_SIZE)
    found = {}
    for index in range(min(count, 100)):
        name, start, size = struct.unpack_from(">4sII", profile, _HEADER_SIZE + 4 + 12 * index)
        found[name] = profile[start : start + size]
    return found


def _curve_at_half(tag: bytes) -> float | None:
    """Evaluate a curveType or parametricCurveType at 0.5; None for other types."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return 0.5
        if count == 1:
            return float(0.5 ** (struct.unpack_from(">H", tag, 12)[0] / 256.0))
        low, high = struct.unpack_from(">2H", tag, 12 + 2 * ((count - 1) // 2))
        return float((low + high) / 2.0 if count % 2 == 0 else low) / 65535.0
    if tag[:4] == b"para":
        kind = struct.unpack_from(">H", tag, 8)[0]
        numbers = [number / 65536.0 for number in struct.unpack_from(f">{(1, 3, 4, 5, 7)[min(kind, 4)]}i", tag, 12)]
        exponent, scale, shift = (*numbers, 1.0, 0.0)[:3] if kind == 0 else numbers[:3]
        summand = {2: 3, 4: 5}.get(kind)  # where the constant c or e is among the numbers
        return float((0.5 * scale + shift) ** exponent + (0.0 if summand is None else numbers[summand]))
    return None

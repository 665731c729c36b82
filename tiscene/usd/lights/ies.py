# SPDX-License-Identifier: Apache-2.0
"""IES photometric files (ANSI/IES LM-63): luminous intensity of a luminaire by direction.

`read_ies` parses a file of photometric type C; `Profile.image` resamples it to the texture that the renderer looks up.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import FloatArray

Floats = NDArray[np.floating]
ROWS, COLUMNS = 360, 360  # resolution of the profile image: 0.5 degrees vertically, 1 degree horizontally
_MAX_ANGLES = 4096  # in each direction
_HEADER_SIZE = 13  # numbers between the tilt data and the angles
_MAX_CANDELA = float(np.finfo(np.float32).max)
_RANGES = ((0.0, 90.0), (0.0, 180.0), (90.0, 270.0), (0.0, 360.0))  # of horizontal angles, degrees, by LM-63


@dataclass(frozen=True, eq=False)
class Profile:
    """A measured distribution of luminous intensity.

    Attributes:
        vertical: angles from the luminaire's axis, degrees, increasing.
        horizontal: angles about the axis, degrees, increasing: one, or 0 to 90, 0 to 180, 90 to 270 or 0 to 360. The
            others mirror them.
        candela: luminous intensity, cd, [horizontal, vertical].
    """

    vertical: Floats
    horizontal: Floats
    candela: Floats

    def intensity(self, vertical: Floats, horizontal: Floats) -> Floats:
        """Interpolate the luminous intensity.

        Args:
            vertical: degrees from the axis, [n].
            horizontal: degrees about the axis, [m].

        Returns:
            cd, [n, m]; 0 beyond the measured vertical angles.
        """
        around = horizontal % 360.0
        last = self.horizontal[-1]
        if len(self.horizontal) == 1:
            around = np.zeros_like(around)
        elif last == 90.0:  # a quadrant, mirrored twice
            around = np.minimum(around % 180.0, 180.0 - around % 180.0)
        elif last == 180.0:
            around = np.minimum(around, 360.0 - around)
        elif self.horizontal[0] == 90.0:  # symmetric about the plane of 90 and 270 degrees
            around = np.where(np.abs(around - 180.0) > 90.0, (180.0 - around) % 360.0, around)
        down = np.array([np.interp(vertical, self.vertical, line, 0.0, 0.0) for line in self.candela])
        at = np.clip(np.searchsorted(self.horizontal, around, side="right") - 1, 0, max(len(self.horizontal) - 2, 0))
        after = np.minimum(at + 1, len(self.horizontal) - 1)
        gap = np.maximum(self.horizontal[after] - self.horizontal[at], 1e-9)
        weight = np.clip((around - self.horizontal[at]) / gap, 0.0, 1.0)[:, None]
        return np.asarray(((1.0 - weight) * down[at] + weight * down[after]).T)

    def power(self) -> float:
        """Return the integral of the intensity over all directions, lm."""
        step = math.pi / ROWS
        down = (np.arange(ROWS) + 0.5) * step
        mean = self.intensity(np.degrees(down), np.arange(COLUMNS) * (360.0 / COLUMNS)).mean(axis=1)
        return float((mean * np.sin(down)).sum() * step * 2.0 * math.pi)

    def image(self, angle_scale: float, normalize: bool, *, mirrored: bool = False) -> FloatArray:
        """Return the profile as an image [h, w, 4] of factors of radiance.

        Rows are angles from the axis, 0 to 180 degrees; columns angles about it, 0 to 360 degrees.

        Args:
            angle_scale: UsdLux's shaping:ies:angleScale. Positive values stretch the profile from its axis by that
                factor, negative ones from the opposite direction; 0 leaves it.
            normalize: whether to divide by the profile's mean (shaping:ies:normalize): over all directions, or over a
                hemisphere for profiles that span no more.
            mirrored: whether the x axis, from which angles about the axis are measured, is flipped.
        """
        down = (np.arange(ROWS) + 0.5) * (180.0 / ROWS)
        if angle_scale > 0.0:
            down = np.clip(down / angle_scale, 0.0, 180.0)
        elif angle_scale < 0.0:
            down = np.clip((down - 180.0) / -angle_scale + 180.0, 0.0, 180.0)
        columns = 1 if len(self.horizontal) == 1 else COLUMNS
        around = (np.arange(columns) + 0.5) * (360.0 / columns)
        values = self.intensity(down, 180.0 - around if mirrored else around)
        mean = self.power() / ((4.0 if np.ptp(self.vertical) > 90.0 else 2.0) * math.pi)
        if normalize and mean > 0.0:
            values = values / mean
        return np.repeat(values[:, :, None], 4, axis=2).astype(np.float32)


def read_ies(data: bytes) -> Profile:
    """Parse an IES file of photometric type C.

    Raises:
        ValueError: the file is damaged, too large, or of another photometric type, or its angles or intensities are
            not those of a luminaire.
    """
    _, tilt, rest = data.decode("latin-1").partition("TILT=")
    if not tilt:
        raise ValueError("not an IES file: it has no line TILT=")
    kind, _, body = rest.partition("\n")
    try:
        numbers = [float(word) for word in re.split(r"[\s,]+", body.strip()) if word]
    except ValueError as error:
        raise ValueError(f"a damaged IES file: {error}") from None
    if kind.strip().upper() == "INCLUDE":  # tilt data: orientation, n, n angles, n factors
        if len(numbers) < 2 or not 0 <= numbers[1] <= _MAX_ANGLES:
            raise ValueError("an IES file that ends early")
        numbers = numbers[2 + 2 * int(numbers[1]) :]
    if len(numbers) < _HEADER_SIZE:
        raise ValueError("an IES file that ends early")
    scale, rows, columns, photometry, ballast = (numbers[place] for place in (2, 3, 4, 5, 10))
    if photometry != 1.0:
        raise ValueError(f"an IES file of photometric type {photometry:g}; only type C (1) can be read")
    if not (1 <= rows <= _MAX_ANGLES and 1 <= columns <= _MAX_ANGLES):
        raise ValueError(f"an IES file of {rows:g} x {columns:g} angles; each number must be in 1..{_MAX_ANGLES}")
    down, around = int(rows), int(columns)
    values = np.array(numbers[_HEADER_SIZE : _HEADER_SIZE + down + around + down * around])
    if len(values) < down + around + down * around or not np.isfinite(values).all():
        raise ValueError("an IES file that ends early or holds numbers that are not finite")
    vertical, horizontal, candela = np.split(values, [down, down + around])
    if (np.diff(vertical) <= 0.0).any() or (np.diff(horizontal) <= 0.0).any():
        raise ValueError("an IES file whose angles do not increase")
    candela, factor = np.maximum(candela.reshape(around, down), 0.0), scale * ballast
    if not (factor >= 0.0 and factor * float(candela.max()) <= _MAX_CANDELA):
        raise ValueError(f"an IES file whose intensities times {scale:g} x {ballast:g} are negative or not finite")
    return _closed(vertical, horizontal, candela * factor)


def _closed(vertical: Floats, horizontal: Floats, candela: Floats) -> Profile:
    """Return a profile, with an angle of 360 degrees where a file leaves it out as equal to that of 0.

    Raises:
        ValueError: the horizontal angles do not say what the intensity is all around.
    """
    first, last = float(horizontal[0]), float(horizontal[-1])
    if len(horizontal) > 1 and (first, last) not in _RANGES:
        if first != 0.0 or not math.isclose(360.0 - last, last - horizontal[-2], abs_tol=0.01):
            ranges = ", ".join(f"{low:g} to {high:g}" for low, high in _RANGES)
            text = f"an IES file of horizontal angles from {first:g} to {last:g} degrees; they must be one of {ranges}"
            raise ValueError(text)
        horizontal, candela = np.append(horizontal, 360.0), np.append(candela, candela[:1], axis=0)
    return Profile(vertical, horizontal, candela)

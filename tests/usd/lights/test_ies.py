# SPDX-License-Identifier: Apache-2.0
"""IES photometric files and their profiles, after UsdLux's rules."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tiscene.usd.lights.ies import read_ies


def ies(
    vertical: list[float], horizontal: list[float], candela: list[list[float]], *, scale: float = 1.0, **more
) -> bytes:
    """Return the bytes of a file. `candela` has a row per horizontal angle, `more` the tilt and photometric type."""
    tilt = more.get("tilt", "TILT=NONE")
    header = f"1 1000 {scale} {len(vertical)} {len(horizontal)} {more.get('kind', 1)} 2 0 0 0\n1 1 100"
    rows = "\n".join(" ".join(map(str, row)) for row in [vertical, horizontal, *candela])
    return f"IESNA:LM-63-2002\n[TEST] a lamp\n{tilt}\n{header}\n{rows}\n".encode()


def test_uniform_profile_has_power_of_four_pi():
    profile = read_ies(ies([0, 90, 180], [0], [[50, 50, 50]], scale=2.0))
    assert profile.power() == pytest.approx(4.0 * math.pi * 100.0, rel=1e-4)
    assert profile.intensity(np.array([0.0, 30.0, 180.0]), np.array([77.0])).tolist() == [[100.0], [100.0], [100.0]]


def test_cosine_profile_has_power_of_pi():
    """Intensity falls as the cosine to 0 at 90 degrees, so the power is pi times the intensity on the axis."""
    angles = np.linspace(0.0, 90.0, 181)
    profile = read_ies(ies(angles.tolist(), [0], [np.cos(np.radians(angles)).tolist()]))
    assert profile.power() == pytest.approx(math.pi, rel=1e-3)
    assert profile.intensity(np.array([60.0, 120.0]), np.array([0.0]))[:, 0] == pytest.approx([0.5, 0.0], abs=1e-9)


def test_profile_is_dark_beyond_its_vertical_angles():
    profile = read_ies(ies([30, 60], [0], [[5, 5]]))
    assert profile.intensity(np.array([29.0, 30.0, 60.0, 61.0]), np.array([0.0]))[:, 0].tolist() == [0.0, 5.0, 5.0, 0.0]


@pytest.mark.parametrize(
    ("horizontal", "expected"),
    [
        ([0, 90], {0: 1, 45: 1.5, 90: 2, 135: 1.5, 180: 1, 270: 2, 350: 1 + 10 / 90}),
        ([0, 180], {0: 1, 90: 1.5, 180: 2, 270: 1.5}),
        ([0, 360], {0: 1, 90: 1.25, 180: 1.5, 270: 1.75}),
        ([90, 180, 270], {90: 1, 135: 1.5, 180: 2, 225: 2.5, 270: 3, 315: 2.5, 0: 2, 45: 1.5, 359: 2 + 1 / 90}),
        ([0, 120, 240], {0: 1, 60: 1.5, 120: 2, 240: 3, 300: 2, 330: 1.5}),  # 360 is left out, as some programs do
    ],
)
def test_horizontal_angles_are_mirrored_by_their_range(horizontal, expected):
    profile = read_ies(ies([0, 180], horizontal, [[k + 1, k + 1] for k in range(len(horizontal))]))
    values = profile.intensity(np.array([10.0]), np.array(list(expected), float))
    np.testing.assert_allclose(values[0], list(expected.values()))


def test_included_tilt_data_is_skipped():
    tilt = "TILT=INCLUDE\n1\n2\n0 90\n1.0 0.9"
    np.testing.assert_array_equal(read_ies(ies([0, 90], [0], [[3, 4]], tilt=tilt)).candela, [[3.0, 4.0]])


@pytest.mark.parametrize(
    ("scale", "at_30", "at_150"),
    [(0.0, 30.0, 150.0), (2.0, 15.0, 75.0), (-2.0, 105.0, 165.0), (0.5, 60.0, 180.0), (-0.5, 0.0, 120.0)],
)
def test_angle_scale_stretches_profile(scale, at_30, at_150):
    """The intensity is the angle plus 1, so the image shows where it was sampled."""
    image = read_ies(ies([0, 180], [0], [[1, 181]])).image(scale, normalize=False)
    assert image.shape == (360, 1, 4)
    sampled, down = image[:, 0, 0] - 1.0, (np.arange(360) + 0.5) / 2.0
    assert np.interp(30.0, down, sampled) == pytest.approx(at_30, abs=1e-4)
    assert np.interp(150.0, down, sampled) == pytest.approx(at_150, abs=1e-4)


@pytest.mark.parametrize(("vertical", "solid_angle"), [([0, 40, 90], 2.0), ([90, 140, 180], 2.0), ([0, 40, 180], 4.0)])
def test_normalized_profile_keeps_the_power_of_an_even_one(vertical, solid_angle):
    """The factors' mean is 1 over the hemisphere or the sphere that the profile spans."""
    image = read_ies(ies(vertical, [0, 90], [[9, 4, 0], [7, 1, 1]])).image(0.0, normalize=True)
    assert image.shape == (360, 360, 4)
    sine = np.sin((np.arange(360) + 0.5) * math.pi / 360.0)
    total = (image[..., 0].mean(axis=1) * sine).sum() * math.pi / 360.0 * 2.0 * math.pi
    assert total == pytest.approx(solid_angle * math.pi, rel=1e-3)


def test_mirrored_profile_has_the_x_axis_flipped():
    profile = read_ies(ies([0, 180], [0, 90, 180, 270, 360], [[each, each] for each in (1, 5, 3, 2, 1)]))
    plain, mirrored = (profile.image(0.0, False, mirrored=flip)[100, :, 0] for flip in (False, True))
    azimuths = np.arange(360)
    np.testing.assert_allclose(mirrored[azimuths], plain[(179 - azimuths) % 360], rtol=1e-6)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"hello", "no line TILT="),
        (b"TILT=NONE\n1 2 three", "damaged"),
        (b"TILT=NONE\n1 2 3", "ends early"),
        (b"TILT=INCLUDE\n1", "ends early"),
        (ies([0, 90], [0], [[1]]), "ends early"),
        (ies([0, 90], [0], [[1, 2]], kind=2), "photometric type 2"),
        (ies([90, 0], [0], [[1, 2]]), "do not increase"),
        (ies([0, 90], [0], [["nan", 2]]), "numbers that are not finite"),
        (ies([0, 90], [0], [[1, 2]], scale=math.nan), "times nan x 1 are negative or not finite"),
        (ies([0, 90], [0], [[0, 2]], scale=1e39), "negative or not finite"),
        (ies([0, 90], [0], [[1e300, 2]], scale=1e300), "negative or not finite"),
        (ies([0, 90], [0], [[1, 2]], scale=-1.0), "negative or not finite"),
        (ies([0, 90], [0, 45], [[1, 2]] * 2), "from 0 to 45 degrees; they must be one of 0 to 90"),
        (ies([0, 90], [0, 90, 270], [[1, 2]] * 3), "from 0 to 270 degrees"),
        (ies([0, 90], [90, 180], [[1, 2]] * 2), "from 90 to 180 degrees"),
        (ies([0, 90], [0], [[1, 2]]).replace(b" 2 1 1 2 ", b" 99999 1 1 2 "), "99999 x 1 angles"),
    ],
)
def test_unreadable_files_raise_value_error(data, expected):
    with pytest.raises(ValueError, match=expected):
        read_ies(data)

# SPDX-License-Identifier: Apache-2.0
"""The sRGB transfer function against values of the standard, and its inverse."""

import numpy as np
import pytest

from tiscene.scene.color import decode_srgb, encode_srgb


def test_encode_srgb_matches_the_standard():
    np.testing.assert_allclose(encode_srgb(np.array([0.0, 0.18, 0.5, 1.0])), [0.0, 0.461356, 0.735357, 1.0], atol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_encode_and_decode_are_inverse(dtype):
    values = np.linspace(-0.5, 2.0, 1001, dtype=dtype)
    for function, inverse in ((encode_srgb, decode_srgb), (decode_srgb, encode_srgb)):
        assert function(values).dtype == dtype
        assert (np.diff(function(values)) > 0.0).all()
        np.testing.assert_allclose(
            inverse(function(values)), values, atol=2e-5
        )  # the standard's two pieces almost meet

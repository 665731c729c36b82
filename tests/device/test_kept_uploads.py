# SPDX-License-Identifier: Apache-2.0
"""Values arrive on the device, in arrays that are kept."""

import numpy as np

from tiscene.device.kept_uploads import KeptUploads


def test_values_arrive_in_arrays_that_are_kept_while_shapes_stay_the_same() -> None:
    random = np.random.default_rng(1)
    uploads = KeptUploads()
    first: list[object] = []
    for _ in range(2):
        values = [random.normal(size=size).astype(np.float32) for size in ((5, 3), (4,), (2, 3, 4))]
        values[0][0, 0] = np.inf
        arrays = uploads.upload(values)
        assert not first or arrays == first
        first = arrays
        for sent, found in zip(values, arrays, strict=True):
            np.testing.assert_array_equal(sent, found.to_numpy())
    assert uploads.upload([np.ones((4, 2), np.float32)])[0].shape == (4, 2)

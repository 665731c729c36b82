# SPDX-License-Identifier: Apache-2.0
"""Arrays that travel as one arrive as they were sent."""

import numpy as np

from tiscene.device.packed_copies import PackedCopies, empty_on_device


def test_arrays_return_as_they_were_sent() -> None:
    random = np.random.default_rng(1)
    copies = PackedCopies()
    for shape in ((5, 3), (2, 7)):  # other sizes need other memory in between
        values = [random.normal(size=size).astype(np.float32) for size in (shape, (4,), (2, 3, 4), (1, 2, 3, 2))]
        values[0][0, 0] = np.inf
        arrays = copies.upload(values)
        for sent, found in zip(values, copies.download(arrays, [np.float32] * 4), strict=True):
            np.testing.assert_array_equal(sent, found)
            assert found.flags.writeable


def test_memory_is_kept_while_the_sizes_stay_the_same() -> None:
    copies = PackedCopies()
    first = copies.upload([np.ones((3, 2), np.float32)])
    assert copies.upload([np.full((3, 2), 2.0, np.float32)]) == first
    np.testing.assert_array_equal(first[0].to_numpy(), 2.0)
    assert copies.upload([np.ones((4, 2), np.float32)])[0].shape == (4, 2)


def test_integers_and_truth_values_keep_their_types() -> None:
    ids, flags = np.array([[1, -5], [1 << 30, 0]], np.int32), np.array([[True, False, True]])
    arrays = [empty_on_device(each.shape, each.dtype) for each in (ids, flags)]
    arrays[0].from_numpy(ids)
    arrays[1].from_numpy(flags.view(np.uint8))
    found = PackedCopies().download(arrays, [each.dtype for each in (ids, flags)])
    for sent, received in zip((ids, flags), found, strict=True):
        assert received.dtype == sent.dtype
        np.testing.assert_array_equal(sent, received)

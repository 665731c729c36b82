# SPDX-License-Identifier: Apache-2.0
"""Arrays and named contents as bytes, without time stamps: equal values give equal bytes."""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image

# The date of all members: the oldest one that a zip file can hold.
EPOCH = (1980, 1, 1, 0, 0, 0)
_SAMPLED = 2048  # bytes of each block of a sample

# Of a file. A function makes them in another thread, while the next frame is rendered.
Contents: TypeAlias = bytes | Callable[[], bytes]


def resolved(contents: Mapping[str, Contents]) -> dict[str, bytes]:
    """Return contents by name, with functions called."""
    return {name: content() if callable(content) else content for name, content in contents.items()}


def json_file(value: Any) -> bytes:
    """Return JSON values as a file with a value on each line."""
    return (json.dumps(value, indent=1) + "\n").encode()


def npy(array: NDArray[Any]) -> bytes:
    """Return an array as a .npy file."""
    data = io.BytesIO()
    np.lib.format.write_array(data, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return data.getvalue()


def from_npy(data: bytes) -> NDArray[Any]:
    """Return the array of a .npy file that `npy` made. It shares the bytes and is not writable."""
    source = io.BytesIO(data)
    np.lib.format.read_magic(source)
    shape, _, dtype = np.lib.format.read_array_header_1_0(source)
    return np.frombuffer(data, dtype, math.prod(shape), source.tell()).reshape(shape)


def png(pixels: NDArray[Any]) -> bytes:
    """Return an image as PNG: uint8 [h, w, 3], uint8 [h, w] or uint16 [h, w]."""
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "png", compress_level=4)
    return data.getvalue()


def archive(members: Mapping[str, bytes]) -> bytes:
    """Return a zip file of contents by name.

    Members are deflated that shrink by that to half or less, judged by a sample; the others, such as depth, would take
    most of the time.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as target:
        for name, content in members.items():
            member = zipfile.ZipInfo(name, EPOCH)
            member.compress_type = zipfile.ZIP_DEFLATED if _shrinks(content) else zipfile.ZIP_STORED
            member.create_system = 3  # Unix, on every platform
            target.writestr(member, content, compresslevel=1)
    return data.getvalue()


def _shrinks(content: bytes) -> bool:
    """Return whether deflating halves some data or more, judged by up to eight blocks from all over it."""
    step = max(_SAMPLED, len(content) // 8)
    sample = b"".join(content[start : start + _SAMPLED] for start in range(0, len(content), step))
    return 2 * len(zlib.compress(sample, 1)) <= len(sample)

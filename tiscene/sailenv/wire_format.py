# SPDX-License-Identifier: Apache-2.0
"""SAILenv's bytes: little endian; a text is its length in bytes (int32) and UTF-8."""

from __future__ import annotations

import asyncio
import gzip
import struct
import zlib
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.camera import Vector3

MAX_TEXT, MAX_JSON = 4096, 16 << 20  # bytes
PATIENCE = 60.0  # s for the rest of a message that has begun


class Command(IntEnum):
    """The first byte of what an agent says."""

    FRAME = 0x00
    DELETE = 0x01
    CHANGE_SCENE = 0x02
    GET_CATEGORIES = 0x03
    GET_POSITION = 0x04
    SET_POSITION = 0x05
    GET_ROTATION = 0x06
    SET_ROTATION = 0x07
    TOGGLE_FOLLOW = 0x08
    SPAWN = 0x09
    DESPAWN = 0x0A
    SPAWNABLES = 0x0B
    SEND_OBJ_ZIP = 0x0C
    CLEAR_FLAGS = 0x0D
    GET_LIGHT_COLOR = 0x0E
    SET_LIGHT_COLOR = 0x0F
    GET_LIGHT_INTENSITY = 0x10
    SET_LIGHT_INTENSITY = 0x11
    GET_LIGHT_INDIRECT = 0x12
    SET_LIGHT_INDIRECT = 0x13
    GET_LIGHT_POSITION = 0x14
    SET_LIGHT_POSITION = 0x15
    GET_LIGHT_DIRECTION = 0x16
    SET_LIGHT_DIRECTION = 0x17
    GET_LIGHT_TYPE = 0x18
    LIGHT_NAMES = 0x19
    GET_AMBIENT = 0x1A
    SET_AMBIENT = 0x1B
    SPAWN_VIEW_FRUSTUM = 0x1C
    LOAD_SCENARIO = 0x1D
    MOVE_OBJECT = 0x1E


class ProtocolError(Exception):
    """What arrived is not what the protocol allows."""


class Reader:
    """What one client sends."""

    def __init__(self, stream: asyncio.StreamReader) -> None:
        self._stream = stream

    async def exactly(self, count: int) -> bytes:
        """Raises IncompleteReadError when the client is gone, TimeoutError when it is silent for too long."""
        async with asyncio.timeout(PATIENCE):
            return await self._stream.readexactly(count)

    async def chunk(self, most: int) -> bytes:
        """What there is, up to so many bytes."""
        async with asyncio.timeout(PATIENCE):
            data = await self._stream.read(most)
        if not data:
            raise asyncio.IncompleteReadError(b"", most)
        return data

    async def command(self) -> Command:
        """The next command, however long the client thinks about it."""
        (byte,) = await self._stream.readexactly(1)
        try:
            return Command(byte)
        except ValueError:
            raise ProtocolError(f"there is no command 0x{byte:02X}") from None

    async def byte(self, patience: float) -> int | None:
        """The next byte, None if none comes in so many seconds."""
        try:
            async with asyncio.timeout(patience):
                return (await self._stream.readexactly(1))[0]
        except TimeoutError:
            return None

    async def flag(self) -> bool:
        return (await self.exactly(1))[0] != 0

    async def int32(self) -> int:
        return int.from_bytes(await self.exactly(4), "little", signed=True)

    async def float32(self) -> float:
        (number,) = struct.unpack("<f", await self.exactly(4))
        return float(number)

    async def ints(self) -> tuple[int, int, int]:
        r, g, b = struct.unpack("<3i", await self.exactly(12))
        return (r, g, b)

    async def vector(self) -> Vector3:
        x, y, z = struct.unpack("<3f", await self.exactly(12))
        return (x, y, z)

    async def text(self, most: int = MAX_TEXT) -> str:
        return await self.text_of(await self.int32(), most)

    async def text_of(self, length: int, most: int = MAX_TEXT) -> str:
        """A text whose length is known already."""
        if not 0 <= length <= most:
            raise ProtocolError(f"a text of {length} bytes; at most {most} are read")
        try:
            return (await self.exactly(length)).decode("utf-8")
        except UnicodeDecodeError as error:
            raise ProtocolError(f"a text that is not UTF-8: {error}") from None


def int_bytes(*numbers: int) -> bytes:
    """int32."""
    return struct.pack(f"<{len(numbers)}i", *numbers)


def float_bytes(*numbers: float) -> bytes:
    """float32."""
    return struct.pack(f"<{len(numbers)}f", *numbers)


def text_bytes(text: str) -> bytes:
    """A text with its length."""
    data = text.encode("utf-8")
    return int_bytes(len(data)) + data


def texts_bytes(texts: list[str]) -> bytes:
    """How many texts, and the texts."""
    return int_bytes(len(texts)) + b"".join(text_bytes(each) for each in texts)


def view_bytes(name: str, view: NDArray[Any], compress: bool) -> bytes:
    """A view with its length."""
    match name:
        case "category":
            data = np.repeat(view[::-1, :, None], 3, axis=2).tobytes()
        case "flow":
            data = np.ascontiguousarray(view[::-1], "<f4").tobytes()
        case _:
            data = png(view)
    if compress:
        data = gzip.compress(data, compresslevel=1, mtime=0)
    return int_bytes(len(data)) + data


def png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG of uint8 [h, w] or [h, w, 3], stored and not compressed: it costs no time, and flow is larger anyway."""
    height, width = pixels.shape[:2]
    rows = np.zeros((height, 1 + pixels[0].size), np.uint8)  # every row begins with its filter, 0: none
    rows[:, 1:] = pixels.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 0)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )

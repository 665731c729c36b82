# SPDX-License-Identifier: Apache-2.0
"""SAILenv's network protocol: command bytes, and encoding of values.

Numbers are little endian. A text is its length in bytes (int32) and its UTF-8 bytes. A view is its length and its
bytes.
"""

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
TIMEOUT = 60.0  # s, for the rest of a message that has begun


class Command(IntEnum):
    """The first byte of a client's message, by SAILenv's names."""

    FRAME = 0x00
    DELETE = 0x01
    CHANGE_SCENE = 0x02
    GET_CATEGORIES = 0x03
    GET_POSITION = 0x04
    SET_POSITION = 0x05
    GET_ROTATION = 0x06
    SET_ROTATION = 0x07
    TOGGLE_FOLLOW = 0x08
    SPAWN_OBJECT = 0x09
    DESPAWN_OBJECT = 0x0A
    GET_SPAWNABLE_OBJECTS_NAMES = 0x0B
    SEND_OBJ_ZIP = 0x0C
    SET_MAIN_CAMERA_CLEAR_FLAGS = 0x0D
    GET_LIGHT_COLOR = 0x0E
    SET_LIGHT_COLOR = 0x0F
    GET_LIGHT_INTENSITY = 0x10
    SET_LIGHT_INTENSITY = 0x11
    GET_LIGHT_INDIRECT_MULTIPLIER = 0x12
    SET_LIGHT_INDIRECT_MULTIPLIER = 0x13
    GET_LIGHT_POSITION = 0x14
    SET_LIGHT_POSITION = 0x15
    GET_LIGHT_DIRECTION = 0x16
    SET_LIGHT_DIRECTION = 0x17
    GET_LIGHT_TYPE = 0x18
    GET_LIGHTS_NAMES = 0x19
    GET_AMBIENT_LIGHT_COLOR = 0x1A
    SET_AMBIENT_LIGHT_COLOR = 0x1B
    SPAWN_VIEW_FRUSTUM = 0x1C
    LOAD_SCENARIO = 0x1D
    MOVE_OBJECT = 0x1E
    ASK_PIXEL = 0x40  # an extension of tiscene


class CommandsBytes:
    """SAILenv's table of commands: `CommandsBytes.FRAME` is the byte of `Command.FRAME`, and so on."""


for _command in Command:
    setattr(CommandsBytes, _command.name, bytes([_command]))


class ProtocolError(Exception):
    """A client violates the protocol."""


class Reader:
    """Reads values that a client sends.

    Methods raise IncompleteReadError if the client disconnects, TimeoutError after TIMEOUT seconds without data, and
    ProtocolError for invalid data.
    """

    def __init__(self, stream: asyncio.StreamReader) -> None:
        self._stream = stream

    async def exactly(self, count: int) -> bytes:
        """Read a number of bytes."""
        async with asyncio.timeout(TIMEOUT):
            return await self._stream.readexactly(count)

    async def chunk(self, limit: int) -> bytes:
        """Read the bytes that have arrived, at least one and at most `limit`."""
        async with asyncio.timeout(TIMEOUT):
            data = await self._stream.read(limit)
        if not data:
            raise asyncio.IncompleteReadError(b"", limit)
        return data

    async def command(self) -> Command:
        """Read the next command, without a timeout."""
        (byte,) = await self._stream.readexactly(1)
        try:
            return Command(byte)
        except ValueError:
            raise ProtocolError(f"unknown command 0x{byte:02X}") from None

    async def byte(self, timeout: float) -> int | None:
        """Read a byte; return None if none arrives within `timeout` seconds."""
        try:
            async with asyncio.timeout(timeout):
                return (await self._stream.readexactly(1))[0]
        except TimeoutError:
            return None

    async def flag(self) -> bool:
        """Read a byte as a bool."""
        return (await self.exactly(1))[0] != 0

    async def int32(self) -> int:
        """Read an integer."""
        return int.from_bytes(await self.exactly(4), "little", signed=True)

    async def float32(self) -> float:
        """Read a number in single precision."""
        (number,) = struct.unpack("<f", await self.exactly(4))
        return float(number)

    async def ints(self) -> tuple[int, int, int]:
        """Read three integers (int32)."""
        r, g, b = struct.unpack("<3i", await self.exactly(12))
        return (r, g, b)

    async def vector(self) -> Vector3:
        """Read three numbers in single precision."""
        x, y, z = struct.unpack("<3f", await self.exactly(12))
        return (x, y, z)

    async def text(self, limit: int = MAX_TEXT) -> str:
        """Read a text of at most `limit` bytes."""
        return await self.text_of(await self.int32(), limit)

    async def text_of(self, length: int, limit: int = MAX_TEXT) -> str:
        """Read a text whose length has been read."""
        if not 0 <= length <= limit:
            raise ProtocolError(f"a text of {length} bytes; the limit is {limit}")
        try:
            return (await self.exactly(length)).decode("utf-8")
        except UnicodeDecodeError as error:
            raise ProtocolError(f"text that is not UTF-8: {error}") from None


def int_bytes(*numbers: int) -> bytes:
    """Encode integers as int32."""
    return struct.pack(f"<{len(numbers)}i", *numbers)


def float_bytes(*numbers: float) -> bytes:
    """Encode numbers in single precision."""
    return struct.pack(f"<{len(numbers)}f", *numbers)


def text_bytes(text: str) -> bytes:
    """Encode a text with its length."""
    data = text.encode("utf-8")
    return int_bytes(len(data)) + data


def texts_bytes(texts: list[str]) -> bytes:
    """Encode a list of texts: their number, and each text."""
    return int_bytes(len(texts)) + b"".join(text_bytes(each) for each in texts)


def view_bytes(name: str, view: NDArray[Any], compress: bool) -> bytes:
    """Encode a view with its length.

    Args:
        name: A key of `frame_views.VIEWS`.
        view: Its array. Category and flow are sent bottom row first, the others as PNG.
        compress: Whether the bytes are compressed by gzip.
    """
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
    """Encode uint8 [h, w] or [h, w, 3] as PNG without compression.

    Compression would cost time and save little: flow, which is not compressed either, is larger.
    """
    height, width = pixels.shape[:2]
    rows = np.zeros((height, 1 + pixels[0].size), np.uint8)  # each row begins with its filter; 0: none
    rows[:, 1:] = pixels.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 0)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )

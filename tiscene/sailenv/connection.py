# SPDX-License-Identifier: Apache-2.0
"""One client of the server: what it says, what it is answered."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from typing import Any, Protocol, TypeVar

from tiscene.errors import TisceneError
from tiscene.sailenv import wire_format
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.frame_views import VIEWS
from tiscene.sailenv.uploaded_models import MAX_BYTES
from tiscene.sailenv.wire_format import Command, ProtocolError, Reader, float_bytes, int_bytes, text_bytes, texts_bytes

log = logging.getLogger("tiscene.sailenv")
# Clients of before 2021 end a spawn two bytes earlier or one: when those are this late, they will not come.
OLD_CLIENT_AFTER = 2.0
Result = TypeVar("Result")


class FrameServer(Protocol):
    """What a connection needs of its server."""

    environment: Environment

    async def do(self, act: Callable[..., Result], *arguments: Any) -> Result:
        """Run `act` on the thread that owns the environment and return its result."""

    async def frame(self, viewer: AgentCamera, wanted: list[str]) -> tuple[dict[str, Any], float]:
        """Render an agent's next frame: its views by name, and its time (s)."""


class Connection:
    """One connection."""

    def __init__(self, server: FrameServer, reader: Reader, writer: asyncio.StreamWriter) -> None:
        self.viewer: AgentCamera | None = None
        self._server = server
        self._environment = server.environment
        self._read = reader
        self._writer = writer
        self._gzip = False
        self._spawn_ends: int | None = None  # how many of the two last bytes of a spawn this client sends
        peer = writer.get_extra_info("peername") or ("?", 0)
        self._name = f"{peer[0]}:{peer[1]}"

    def __str__(self) -> str:
        return self._name if self.viewer is None else f"agent {self.viewer.id} ({self._name})"

    def note(self, text: str) -> None:
        """A line in the log."""
        log.info("%s %s", self, text)

    async def talk(self) -> None:
        """Register, then do as told until DELETE."""
        width, height, self._gzip = await self._read.int32(), await self._read.int32(), await self._read.flag()
        try:
            self.viewer = await self._do(self._environment.register, width, height)
        except TisceneError as error:
            raise ProtocolError(str(error)) from None
        self.note(f"registered, {width}x{height}{', gzip' if self._gzip else ''}")
        await self._send(int_bytes(self.viewer.id) + texts_bytes(self._environment.scenes()))
        while (command := await self._read.command()) is not Command.DELETE:
            await ANSWERS[command](self, self.viewer)
        self.note("deleted")

    # Each of these reads what follows a command, and answers.

    async def frame(self, viewer: AgentCamera) -> None:
        flags = (await self._read.exactly(1))[0]
        wanted = [name for name, view in VIEWS.items() if flags & view.flag]
        shown, seconds = await self._server.frame(viewer, wanted)
        parts = await asyncio.to_thread(
            lambda: [wire_format.view_bytes(name, view, self._gzip) for name, view in shown.items()]
        )
        log.debug("%s frame %d", self, viewer.taken)
        await self._send(b"".join(parts) + float_bytes(seconds))

    async def change_scene(self, viewer: AgentCamera) -> None:
        name = await self._read.text()
        await self._told(f"change_scene {name}", self._environment.change_scene, name)

    async def categories(self, viewer: AgentCamera) -> None:
        categories = await self._do(self._environment.categories)
        pairs = b"".join(int_bytes(number) + text_bytes(name) for number, name in categories.items())
        await self._send(int_bytes(len(categories)) + pairs)

    async def position(self, viewer: AgentCamera) -> None:
        await self._send(float_bytes(*await self._do(self._environment.position, viewer)))

    async def set_position(self, viewer: AgentCamera) -> None:
        position = await self._read.vector()
        await self._told(f"set_position {position}", self._environment.place, viewer, position, None)

    async def rotation(self, viewer: AgentCamera) -> None:
        await self._send(float_bytes(*await self._do(self._environment.rotation, viewer)))

    async def set_rotation(self, viewer: AgentCamera) -> None:
        rotation = await self._read.vector()
        await self._told(f"set_rotation {rotation}", self._environment.place, viewer, None, rotation)

    async def toggle_follow(self, viewer: AgentCamera) -> None:
        await self._told("toggle_follow", self._environment.toggle_follow, viewer)

    async def spawn(self, viewer: AgentCamera) -> None:
        name, position, rotation = await self._read.text(), await self._read.vector(), await self._read.vector()
        await self._read.flag()  # whether to remove default dynamics; there are none
        scale = await self._read.vector()
        await self._read.flag()  # whether to use the parent; places are the world's
        frustum_limited, dynamic = await self._end_of_spawn()

        def act() -> str:
            return self._environment.spawn(
                viewer,
                name,
                position,
                rotation,
                scale=scale,
                frustum_limited=frustum_limited,
                dynamic=None if dynamic is None else (dynamic[0], _json(dynamic[1])),
            )

        await self._send(text_bytes(await self._tried(f"spawn {name}", act) or ""))

    async def _end_of_spawn(self) -> tuple[bool, tuple[str, str] | None]:
        """Whether the frustum limits it, and type and JSON of its dynamic, from clients of any age."""
        flags: list[int] = []
        while len(flags) < 2 and self._spawn_ends != len(flags):
            flag = await self._read.byte(OLD_CLIENT_AFTER if self._spawn_ends is None else wire_format.PATIENCE)
            if flag is None:
                break
            flags.append(flag)
        length = None
        if len(flags) == 2 and flags[1] > 1:
            # Not a flag, but the first byte of a text's length: the flag before it was the last.
            length = int.from_bytes(bytes(flags[1:]) + await self._read.exactly(3), "little", signed=True)
            flags.pop()
        self._spawn_ends = len(flags)
        if not flags or not flags[-1]:
            return len(flags) < 2 or bool(flags[0]), None
        kind = await (self._read.text() if length is None else self._read.text_of(length))
        return len(flags) < 2 or bool(flags[0]), (kind, await self._read.text(wire_format.MAX_JSON))

    async def despawn(self, viewer: AgentCamera) -> None:
        number = await self._read.int32()
        await self._told(f"despawn {number}", self._environment.despawn, viewer, number)

    async def spawnables(self, viewer: AgentCamera) -> None:
        await self._send(texts_bytes(self._environment.spawnable()))

    async def send_obj_zip(self, viewer: AgentCamera) -> None:
        name, size = await self._read.text(), await self._read.int32()
        if not 0 <= size <= MAX_BYTES:
            raise ProtocolError(f"a file of {size} bytes; at most {MAX_BYTES} are taken")
        data = bytearray()
        while len(data) < size:
            data += await self._read.chunk(min(size - len(data), 1 << 16))
        path = await self._tried(f"send_obj_zip {name}, {size} bytes", self._environment.uploads.store, name, data)
        await self._send(text_bytes(path or ""))

    async def clear_flags(self, viewer: AgentCamera) -> None:
        color = await self._read.ints()
        await self._told(f"clear_flags {color}", self._environment.clear, viewer, color)

    async def light_names(self, viewer: AgentCamera) -> None:
        await self._send(texts_bytes(list((await self._do(lambda: self._environment.lights)).names)))

    async def ambient(self, viewer: AgentCamera) -> None:
        await self._send(text_bytes("ok") + int_bytes(*await self._do(lambda: self._environment.ambient)))

    async def set_ambient(self, viewer: AgentCamera) -> None:
        color = await self._read.ints()
        await self._told(f"set_ambient_light_color {color}", self._environment.set_ambient, color)

    async def spawn_view_frustum(self, viewer: AgentCamera) -> None:
        await self._tried("spawn_view_frustum", self._environment.set_frustum_walls, viewer)

    async def load_scenario(self, viewer: AgentCamera) -> None:
        content = _json(await self._read.text(wire_format.MAX_JSON))
        objects = content.get("objects")
        count = len(objects) if isinstance(objects, list) else 0
        ids, problems = await self._tried(
            f"load_scenario {content.get('scene_name')}, {count} objects", self._environment.load, viewer, content
        ) or ([""] * count, [])
        for problem in problems:
            log.warning("%s %s", self, problem)
        await self._send(b"".join(text_bytes(id) for id in ids))

    async def move_object(self, viewer: AgentCamera) -> None:
        number, position, rotation = await self._read.int32(), await self._read.vector(), await self._read.vector()
        await self._told(f"move {number}", self._environment.move, viewer, number, position, rotation)

    async def get_light(self, what: str, as_bytes: Callable[..., bytes]) -> None:
        name = await self._read.text()
        try:
            value = await self._do(lambda: getattr(self._environment.lights, what)(name))
        except TisceneError as error:
            await self._send(text_bytes(str(error)))
            return
        await self._send(text_bytes("ok") + (as_bytes(*value) if isinstance(value, tuple) else as_bytes(value)))

    async def set_light(self, what: str, read: Callable[[Reader], Awaitable[Any]]) -> None:
        name = await self._read.text()
        value = await read(self._read)
        await self._told(
            f"set_{what} {name} {value}", lambda: getattr(self._environment.lights, f"set_{what}")(name, value)
        )

    async def light_type(self, viewer: AgentCamera) -> None:
        name = await self._read.text()
        kind = await self._tried(f"get_light_type {name}", lambda: self._environment.lights.type(name))
        await self._send(text_bytes(kind or "light_not_found"))

    # How.

    async def _do(self, act: Callable[..., Result], *arguments: Any) -> Result:
        return await self._server.do(act, *arguments)

    async def _tried(self, what: str, act: Callable[..., Result], *arguments: Any) -> Result | None:
        """What `act` gives, None where it fails; a line in the log either way."""
        try:
            result = await self._do(act, *arguments)
        except TisceneError as error:
            log.warning("%s %s: %s", self, what, error)
            return None
        self.note(what)
        return result

    async def _told(self, what: str, act: Callable[..., Any], *arguments: Any) -> None:
        """Do something, and answer "ok" or what is wrong."""
        try:
            await self._do(act, *arguments)
        except TisceneError as error:
            log.warning("%s %s: %s", self, what, error)
            await self._send(text_bytes(str(error)))
        else:
            self.note(what)
            await self._send(text_bytes("ok"))

    async def _send(self, data: bytes) -> None:
        self._writer.write(data)
        async with asyncio.timeout(wire_format.PATIENCE):
            await self._writer.drain()


def _json(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"a description that is no JSON: {error}") from None
    if not isinstance(content, dict):
        raise ProtocolError("a description that is no JSON object")
    return content


def _get(what: str, as_bytes: Callable[..., bytes]) -> Callable[[Connection, AgentCamera], Awaitable[None]]:
    return lambda client, _: client.get_light(what, as_bytes)


def _set(what: str, read: Callable[[Reader], Awaitable[Any]]) -> Callable[[Connection, AgentCamera], Awaitable[None]]:
    return lambda client, _: client.set_light(what, read)


ANSWERS: dict[Command, Callable[[Connection, AgentCamera], Awaitable[None]]] = {
    Command.FRAME: Connection.frame,
    Command.CHANGE_SCENE: Connection.change_scene,
    Command.GET_CATEGORIES: Connection.categories,
    Command.GET_POSITION: Connection.position,
    Command.SET_POSITION: Connection.set_position,
    Command.GET_ROTATION: Connection.rotation,
    Command.SET_ROTATION: Connection.set_rotation,
    Command.TOGGLE_FOLLOW: Connection.toggle_follow,
    Command.SPAWN: Connection.spawn,
    Command.DESPAWN: Connection.despawn,
    Command.SPAWNABLES: Connection.spawnables,
    Command.SEND_OBJ_ZIP: Connection.send_obj_zip,
    Command.CLEAR_FLAGS: Connection.clear_flags,
    Command.GET_LIGHT_COLOR: _get("color", int_bytes),
    Command.SET_LIGHT_COLOR: _set("color", Reader.ints),
    Command.GET_LIGHT_INTENSITY: _get("intensity", float_bytes),
    Command.SET_LIGHT_INTENSITY: _set("intensity", Reader.float32),
    Command.GET_LIGHT_INDIRECT: _get("indirect_multiplier", float_bytes),
    Command.SET_LIGHT_INDIRECT: _set("indirect_multiplier", Reader.float32),
    Command.GET_LIGHT_POSITION: _get("position", float_bytes),
    Command.SET_LIGHT_POSITION: _set("position", Reader.vector),
    Command.GET_LIGHT_DIRECTION: _get("direction", float_bytes),
    Command.SET_LIGHT_DIRECTION: _set("direction", Reader.vector),
    Command.GET_LIGHT_TYPE: Connection.light_type,
    Command.LIGHT_NAMES: Connection.light_names,
    Command.GET_AMBIENT: Connection.ambient,
    Command.SET_AMBIENT: Connection.set_ambient,
    Command.SPAWN_VIEW_FRUSTUM: Connection.spawn_view_frustum,
    Command.LOAD_SCENARIO: Connection.load_scenario,
    Command.MOVE_OBJECT: Connection.move_object,
}

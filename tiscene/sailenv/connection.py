# SPDX-License-Identifier: Apache-2.0
"""One client's connection to the server: reads its commands, carries them out, and sends the replies.

Each command of the protocol has a handler, a method of `Connection`, in the table HANDLERS.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from typing import Any, Protocol, TypeAlias, TypeVar

from tiscene.errors import TisceneError
from tiscene.sailenv import asset_names, wire_format
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.frame_views import VIEWS
from tiscene.sailenv.uploaded_models import MAX_BYTES
from tiscene.sailenv.wire_format import Command, ProtocolError, Reader, float_bytes, int_bytes, text_bytes, texts_bytes

logger = logging.getLogger("tiscene.sailenv")
OLD_CLIENT_TIMEOUT = 2.0  # s, for the last two flags of a spawn, of which clients before 2021 send one or none
Result = TypeVar("Result")


class FrameServer(Protocol):
    """The part of the server that a connection uses."""

    worlds: AgentWorlds

    async def call(self, function: Callable[[], Result]) -> Result:
        """Call a function on the thread that owns the worlds, and return its result."""

    async def frame(self, agent: AgentCamera, views: list[str]) -> tuple[dict[str, Any], float]:
        """Return views of an agent's next frame by name, and the time since its last frame, s."""


class Connection:
    """The connection of one client.

    Attributes:
        agent: The client's agent; None before it has registered.
    """

    def __init__(self, server: FrameServer, reader: Reader, writer: asyncio.StreamWriter) -> None:
        self.agent: AgentCamera | None = None
        self._server = server
        self._worlds = server.worlds
        self._read = reader
        self._writer = writer
        self._gzip = False
        self._spawn_flags: int | None = None  # how many of the last two flags of a spawn this client sends
        peer = writer.get_extra_info("peername") or ("?", 0)
        self._name = f"{peer[0]}:{peer[1]}"

    def __str__(self) -> str:
        return self._name if self.agent is None else f"agent {self.agent.id} ({self._name})"

    def log(self, text: str) -> None:
        """Write a line about this client to the log."""
        logger.info("%s %s", self, text)

    async def run(self) -> None:
        """Register the agent, then handle commands until DELETE."""
        width, height, self._gzip = await self._read.int32(), await self._read.int32(), await self._read.flag()
        try:
            self.agent = await self._call(lambda: self._worlds.register(width, height))
        except TisceneError as error:
            raise ProtocolError(str(error)) from None
        self.log(f"registered, {width}x{height}{', gzip' if self._gzip else ''}")
        await self._send(int_bytes(self.agent.id) + texts_bytes(asset_names.scenes()))
        while (command := await self._read.command()) is not Command.DELETE:
            await HANDLERS[command](self, self.agent)
        self.log("deleted")

    # Handlers: each reads the arguments of a command and sends the reply.

    async def frame(self, agent: AgentCamera) -> None:
        flags = (await self._read.exactly(1))[0]
        names = [name for name, view in VIEWS.items() if flags & view.flag]
        views, seconds = await self._server.frame(agent, names)
        parts = await asyncio.to_thread(
            lambda: [wire_format.view_bytes(name, view, self._gzip) for name, view in views.items()]
        )
        logger.debug("%s frame %d", self, agent.last_frame)
        await self._send(b"".join(parts) + float_bytes(seconds))

    async def change_scene(self, agent: AgentCamera) -> None:
        name = await self._read.text()
        await self._acknowledge(f"change_scene {name}", lambda: self._worlds.change_scene(agent, name))

    async def categories(self, agent: AgentCamera) -> None:
        categories = await self._call(lambda: self._world(agent).categories())
        pairs = b"".join(int_bytes(number) + text_bytes(name) for number, name in categories.items())
        await self._send(int_bytes(len(categories)) + pairs)

    async def position(self, agent: AgentCamera) -> None:
        await self._send(float_bytes(*await self._call(lambda: self._world(agent).position(agent))))

    async def set_position(self, agent: AgentCamera) -> None:
        position = await self._read.vector()
        await self._acknowledge(f"set_position {position}", lambda: self._world(agent).set_pose(agent, position))

    async def rotation(self, agent: AgentCamera) -> None:
        await self._send(float_bytes(*await self._call(lambda: self._world(agent).rotation(agent))))

    async def set_rotation(self, agent: AgentCamera) -> None:
        rotation = await self._read.vector()
        await self._acknowledge(f"set_rotation {rotation}", lambda: self._world(agent).set_pose(agent, None, rotation))

    async def toggle_follow(self, agent: AgentCamera) -> None:
        await self._acknowledge("toggle_follow", lambda: self._world(agent).toggle_follow(agent))

    async def spawn(self, agent: AgentCamera) -> None:
        name, position, rotation = await self._read.text(), await self._read.vector(), await self._read.vector()
        remove_default_dynamics = await self._read.flag()
        scale = await self._read.vector()
        await self._read.flag()  # use_parent: has no effect
        frustum_limited, dynamic = await self._read_spawn_flags()

        def spawn() -> str:
            return self._world(agent).spawn(
                agent,
                name,
                position,
                rotation,
                scale=scale,
                frustum_limited=frustum_limited,
                dynamic=None if dynamic is None else (dynamic[0], _json(dynamic[1])),
                remove_default_dynamics=remove_default_dynamics,
            )

        await self._send(text_bytes(await self._try(f"spawn {name}", spawn) or ""))

    async def _read_spawn_flags(self) -> tuple[bool, tuple[str, str] | None]:
        """Read `frustum_limited`, and type and JSON of the dynamic, from clients of any version."""
        flags: list[int] = []
        while len(flags) < 2 and self._spawn_flags != len(flags):
            flag = await self._read.byte(OLD_CLIENT_TIMEOUT if self._spawn_flags is None else wire_format.TIMEOUT)
            if flag is None:
                break
            flags.append(flag)
        length = None
        if len(flags) == 2 and flags[1] > 1:
            # This is not a flag but the first byte of the length of a text: the client sends one flag.
            length = int.from_bytes(bytes(flags[1:]) + await self._read.exactly(3), "little", signed=True)
            flags.pop()
        self._spawn_flags = len(flags)
        if not flags or not flags[-1]:
            return len(flags) < 2 or bool(flags[0]), None
        kind = await (self._read.text() if length is None else self._read.text_of(length))
        return len(flags) < 2 or bool(flags[0]), (kind, await self._read.text(wire_format.MAX_JSON))

    async def despawn(self, agent: AgentCamera) -> None:
        number = await self._read.int32()
        await self._acknowledge(f"despawn {number}", lambda: self._world(agent).despawn(agent, number))

    async def spawnables(self, agent: AgentCamera) -> None:
        await self._send(texts_bytes(await self._call(lambda: self._world(agent).spawnable())))

    async def send_obj_zip(self, agent: AgentCamera) -> None:
        name, size = await self._read.text(), await self._read.int32()
        if not 0 <= size <= MAX_BYTES:
            raise ProtocolError(f"a file of {size} bytes; the limit is {MAX_BYTES}")
        data = bytearray()
        while len(data) < size:
            data += await self._read.chunk(min(size - len(data), 1 << 16))
        path = await self._try(f"send_obj_zip {name}, {size} bytes", lambda: self._worlds.uploads.store(name, data))
        await self._send(text_bytes(path or ""))

    async def clear_flags(self, agent: AgentCamera) -> None:
        color = await self._read.ints()
        await self._acknowledge(f"clear_flags {color}", lambda: self._world(agent).set_background(agent, color))

    async def light_names(self, agent: AgentCamera) -> None:
        await self._send(texts_bytes(list((await self._call(lambda: self._world(agent).lights)).names)))

    async def ambient(self, agent: AgentCamera) -> None:
        await self._send(text_bytes("ok") + int_bytes(*await self._call(lambda: self._world(agent).ambient)))

    async def set_ambient(self, agent: AgentCamera) -> None:
        color = await self._read.ints()
        await self._acknowledge(
            f"set_ambient_light_color {color}", lambda: self._world(agent).set_ambient(agent, color)
        )

    async def spawn_view_frustum(self, agent: AgentCamera) -> None:
        await self._try("spawn_view_frustum", lambda: self._world(agent).set_frustum_walls(agent))

    async def load_scenario(self, agent: AgentCamera) -> None:
        content = _json(await self._read.text(wire_format.MAX_JSON))
        objects = content.get("objects")
        count = len(objects) if isinstance(objects, list) else 0
        ids, problems = await self._try(
            f"load_scenario {content.get('scene_name')}, {count} objects",
            lambda: self._worlds.load_scenario(agent, content),
        ) or ([""] * count, [])
        for problem in problems:
            logger.warning("%s %s", self, problem)
        await self._send(b"".join(text_bytes(id) for id in ids))

    async def move_object(self, agent: AgentCamera) -> None:
        number, position, rotation = await self._read.int32(), await self._read.vector(), await self._read.vector()
        await self._acknowledge(f"move {number}", lambda: self._world(agent).move(agent, number, position, rotation))

    async def ask_pixel(self, agent: AgentCamera) -> None:
        y, x = await self._read.int32(), await self._read.int32()
        try:
            answer = await self._call(lambda: self._world(agent).ask_pixel(agent, y, x))
        except TisceneError as error:
            await self._send(text_bytes(str(error)))
            return
        left = -1 if answer.left is None else answer.left
        numbers = int_bytes(answer.frame, answer.category, answer.object, left)
        await self._send(text_bytes("ok") + numbers + text_bytes(answer.name))

    async def get_light(self, agent: AgentCamera, quantity: str, as_bytes: Callable[..., bytes]) -> None:
        name = await self._read.text()
        try:
            value = await self._call(lambda: getattr(self._world(agent).lights, quantity)(name))
        except TisceneError as error:
            await self._send(text_bytes(str(error)))
            return
        await self._send(text_bytes("ok") + (as_bytes(*value) if isinstance(value, tuple) else as_bytes(value)))

    async def set_light(self, agent: AgentCamera, quantity: str, read: Callable[[Reader], Awaitable[Any]]) -> None:
        name = await self._read.text()
        value = await read(self._read)
        await self._acknowledge(
            f"set_{quantity} {name} {value}", lambda: self._world(agent).set_light(agent, quantity, name, value)
        )

    async def light_type(self, agent: AgentCamera) -> None:
        name = await self._read.text()
        kind = await self._try(f"get_light_type {name}", lambda: self._world(agent).lights.type(name))
        await self._send(text_bytes(kind or "light_not_found"))

    # Implementation

    def _world(self, agent: AgentCamera) -> Environment:
        """Return the agent's world; on the thread that owns the worlds, as all calls of its methods."""
        return self._worlds.world_of(agent)

    async def _call(self, function: Callable[[], Result]) -> Result:
        return await self._server.call(function)

    async def _try(self, description: str, function: Callable[[], Result]) -> Result | None:
        """Return the result of a call; None if it raises a TisceneError. Log either."""
        try:
            result = await self._call(function)
        except TisceneError as error:
            logger.warning("%s %s: %s", self, description, error)
            return None
        self.log(description)
        return result

    async def _acknowledge(self, description: str, function: Callable[[], object]) -> None:
        """Call a function and send "ok", or the message of the TisceneError that it raises. Log either."""
        try:
            await self._call(function)
        except TisceneError as error:
            logger.warning("%s %s: %s", self, description, error)
            await self._send(text_bytes(str(error)))
        else:
            self.log(description)
            await self._send(text_bytes("ok"))

    async def _send(self, data: bytes) -> None:
        self._writer.write(data)
        async with asyncio.timeout(wire_format.TIMEOUT):
            await self._writer.drain()


def _json(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"invalid JSON: {error}") from None
    if not isinstance(content, dict):
        raise ProtocolError("JSON that is not an object")
    return content


Handler: TypeAlias = Callable[[Connection, AgentCamera], Awaitable[None]]


def _get(quantity: str, as_bytes: Callable[..., bytes]) -> Handler:
    return lambda client, agent: client.get_light(agent, quantity, as_bytes)


def _set(quantity: str, read: Callable[[Reader], Awaitable[Any]]) -> Handler:
    return lambda client, agent: client.set_light(agent, quantity, read)


HANDLERS: dict[Command, Handler] = {
    Command.FRAME: Connection.frame,
    Command.CHANGE_SCENE: Connection.change_scene,
    Command.GET_CATEGORIES: Connection.categories,
    Command.GET_POSITION: Connection.position,
    Command.SET_POSITION: Connection.set_position,
    Command.GET_ROTATION: Connection.rotation,
    Command.SET_ROTATION: Connection.set_rotation,
    Command.TOGGLE_FOLLOW: Connection.toggle_follow,
    Command.SPAWN_OBJECT: Connection.spawn,
    Command.DESPAWN_OBJECT: Connection.despawn,
    Command.GET_SPAWNABLE_OBJECTS_NAMES: Connection.spawnables,
    Command.SEND_OBJ_ZIP: Connection.send_obj_zip,
    Command.SET_MAIN_CAMERA_CLEAR_FLAGS: Connection.clear_flags,
    Command.GET_LIGHT_COLOR: _get("color", int_bytes),
    Command.SET_LIGHT_COLOR: _set("color", Reader.ints),
    Command.GET_LIGHT_INTENSITY: _get("intensity", float_bytes),
    Command.SET_LIGHT_INTENSITY: _set("intensity", Reader.float32),
    Command.GET_LIGHT_INDIRECT_MULTIPLIER: _get("indirect_multiplier", float_bytes),
    Command.SET_LIGHT_INDIRECT_MULTIPLIER: _set("indirect_multiplier", Reader.float32),
    Command.GET_LIGHT_POSITION: _get("position", float_bytes),
    Command.SET_LIGHT_POSITION: _set("position", Reader.vector),
    Command.GET_LIGHT_DIRECTION: _get("direction", float_bytes),
    Command.SET_LIGHT_DIRECTION: _set("direction", Reader.vector),
    Command.GET_LIGHT_TYPE: Connection.light_type,
    Command.GET_LIGHTS_NAMES: Connection.light_names,
    Command.GET_AMBIENT_LIGHT_COLOR: Connection.ambient,
    Command.SET_AMBIENT_LIGHT_COLOR: Connection.set_ambient,
    Command.SPAWN_VIEW_FRUSTUM: Connection.spawn_view_frustum,
    Command.LOAD_SCENARIO: Connection.load_scenario,
    Command.MOVE_OBJECT: Connection.move_object,
    Command.ASK_PIXEL: Connection.ask_pixel,
}

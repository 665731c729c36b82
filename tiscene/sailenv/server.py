# SPDX-License-Identifier: Apache-2.0
"""TCP server for SAILenv clients: several clients, in one world or several.

One asyncio task per client reads and writes; one thread makes all calls of the worlds. A client that violates the
protocol, stalls or disconnects is dropped, without effect on the others. Before the frame clock of a
world advances, the server waits for the clients in it that request frames and have not had the current one. A client
that exceeds that time is not waited for again until it requests a frame.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import socket
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from tiscene.errors import ArgumentError
from tiscene.sailenv import wire_format
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.connection import Connection
from tiscene.sailenv.wire_format import ProtocolError, Reader

logger = logging.getLogger("tiscene.sailenv")
MAX_CLIENTS = 64
Result = TypeVar("Result")


class Server:
    """A TCP server.

    Attributes:
        worlds: The worlds of its clients.
        host: The address to listen on.
        port: The port; 0 for any free one.
        wait: How long the clock waits for a slow client, s.

    Raises:
        ArgumentError: The host is empty.
    """

    def __init__(self, worlds: AgentWorlds, host: str = "127.0.0.1", port: int = 8085, wait: float = 1.0) -> None:
        if not host:  # asyncio would listen on all networks
            raise ArgumentError("host='': is empty; 127.0.0.1 is this machine alone, 0.0.0.0 all of its networks")
        self.worlds = worlds
        self.host, self.port, self.wait = host, port, wait
        self._thread = ThreadPoolExecutor(1, "worlds")
        self._clients: set[asyncio.Task[None]] = set()
        self._progress = asyncio.Event()  # set, then replaced, after each frame and each disconnection
        self._stop = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def run(self, started: Callable[[str, int], None] = lambda host, port: None) -> None:
        """Serve until SIGINT or SIGTERM.

        Args:
            started: Called with host and port once clients can connect.

        Raises:
            OSError: The address cannot be listened on.
        """
        self._loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(
                NotImplementedError, RuntimeError, ValueError
            ):  # on Windows, and outside the main thread
                self._loop.add_signal_handler(number, self._stop.set)
        server = await self._loop.create_server(lambda: _Protocol(self._serve), self.host, self.port)
        try:
            host, port = server.sockets[0].getsockname()[:2]
            started(host, port)
            await self._stop.wait()
            logger.info("stopping")
        finally:
            server.close()
            for task in self._clients:
                task.cancel()
            await asyncio.gather(*self._clients, return_exceptions=True)
            self._thread.shutdown()
            self.worlds.close()

    def stop(self) -> None:
        """Make `run` return; may be called from any thread."""
        assert self._loop is not None
        self._loop.call_soon_threadsafe(self._stop.set)

    async def _serve(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._clients.add(task)
        client = Connection(self, Reader(stream), writer)
        grace = 0.0  # s, for replies that the client has not taken yet
        try:
            if len(self._clients) > MAX_CLIENTS:
                raise ProtocolError(f"too many clients; the limit is {MAX_CLIENTS}")
            await client.run()
            grace = wire_format.TIMEOUT
        except (asyncio.IncompleteReadError, ConnectionError):
            client.log("disconnected")
            grace = wire_format.TIMEOUT
        except TimeoutError:
            client.log("dropped: timeout in the middle of a message")
        except ProtocolError as error:
            client.log(f"dropped: {error}")
        except asyncio.CancelledError:
            client.log("dropped: the server stops")
        except Exception:
            logger.exception("%s dropped after an error in tiscene", client)
        finally:
            if grace > 0.0:
                writer.close()  # which keeps the socket until all is sent
                asyncio.get_running_loop().call_later(grace, _drop_unsent, writer.transport)
            else:
                writer.transport.abort()
            self._clients.discard(task)
            if (agent := client.agent) is not None:
                with contextlib.suppress(RuntimeError, asyncio.CancelledError):  # the server is stopping
                    await asyncio.shield(self.call(lambda: self.worlds.delete(agent)))
                self._wake_waiting()

    async def call(self, function: Callable[[], Result]) -> Result:
        """Call a function on the thread that owns the worlds, and return its result."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, function)

    async def frame(self, agent: AgentCamera, views: list[str]) -> tuple[dict[str, Any], float]:
        """Return an agent's next frame, as of `Environment.frame`.

        Waits until the other clients that request frames have had the current one, for at most `wait` seconds.
        """
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self.wait
        while True:
            progress = self._progress  # before the query, so that no progress in between is missed
            slow = await self.call(lambda: self.worlds.world_of(agent).agents_to_wait_for(agent))
            if not slow:
                break
            try:
                async with asyncio.timeout_at(deadline):
                    await progress.wait()
            except TimeoutError:
                for each in slow:
                    each.is_stepping = False
        result = await self.call(lambda: self.worlds.world_of(agent).frame(agent, views))
        self._wake_waiting()
        return result

    def _wake_waiting(self) -> None:
        """Wake the tasks that wait for other clients."""
        self._progress.set()
        self._progress = asyncio.Event()


def _drop_unsent(transport: asyncio.WriteTransport) -> None:
    """Abort a connection that is closed once all is sent, if something is left to send: one that has ended cannot."""
    if transport.get_write_buffer_size() > 0:
        transport.abort()


class _Protocol(asyncio.StreamReaderProtocol):
    """The streams of a connection, which acknowledges at once what arrives.

    SAILenv's client sends a command and each of its arguments by themselves, and its system holds a small packet back
    until the one before is acknowledged (Nagle's algorithm, RFC 896). Since systems delay that, each turn of a camera
    would take 40 ms. Only Linux has the option, which it resets by itself.
    """

    def __init__(self, serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]) -> None:
        super().__init__(asyncio.StreamReader(), serve)
        self._connection: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._connection = transport.get_extra_info("socket")

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if hasattr(socket, "TCP_QUICKACK"):
            with contextlib.suppress(OSError):  # the client has gone
                self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

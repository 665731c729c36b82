# SPDX-License-Identifier: Apache-2.0
"""SAILenv's protocol over TCP: several clients, one environment.

One task a client reads and writes; one thread does all that touches the world. A client that breaks the protocol,
stalls or vanishes is dropped, and nothing else happens. Before the clock goes on it waits a little for clients that
take frames and have not had the current one; one that lets it wait in vain is not waited for again until it asks for
a frame.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.connection import Connection
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.wire_format import ProtocolError, Reader

log = logging.getLogger("tiscene.sailenv")
MAX_CLIENTS = 64
Result = TypeVar("Result")


class Server:
    """Serves an environment. wait: s that the clock waits for a client that is behind."""

    def __init__(self, environment: Environment, host: str = "127.0.0.1", port: int = 8085, wait: float = 1.0) -> None:
        self.environment = environment
        self.host, self.port, self.wait = host, port, wait
        self._world = ThreadPoolExecutor(1, "world")
        self._clients: set[asyncio.Task[None]] = set()
        self._progress = asyncio.Event()  # set, and replaced, when the clock or those who wait for it have gone on
        self._stop = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def run(self, started: Callable[[str, int], None] = lambda host, port: None) -> None:
        """Serve until SIGINT or SIGTERM. started: is told the address. Raises OSError if it cannot be had."""
        self._loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):  # not everywhere, not in threads
                self._loop.add_signal_handler(number, self._stop.set)
        server = await asyncio.start_server(self._serve, self.host, self.port)
        try:
            host, port = server.sockets[0].getsockname()[:2]
            started(host, port)
            await self._stop.wait()
            log.info("stopping")
        finally:
            server.close()
            for task in self._clients:
                task.cancel()
            await asyncio.gather(*self._clients, return_exceptions=True)
            self._world.shutdown()
            self.environment.close()

    def stop(self) -> None:
        """End `run`, from any thread."""
        assert self._loop is not None
        self._loop.call_soon_threadsafe(self._stop.set)

    async def _serve(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._clients.add(task)
        client = Connection(self, Reader(stream), writer)
        try:
            if len(self._clients) > MAX_CLIENTS:
                raise ProtocolError(f"there are {MAX_CLIENTS} clients already")
            await client.talk()
        except (asyncio.IncompleteReadError, ConnectionError):
            client.note("gone")
        except TimeoutError:
            client.note("dropped: silent in the middle of a message")
        except ProtocolError as error:
            client.note(f"dropped: {error}")
        except asyncio.CancelledError:
            client.note("dropped: the server stops")
        except Exception:
            log.exception("%s dropped: this is a mistake in tiscene", client)
        finally:
            self._clients.discard(task)
            if client.viewer is not None:
                with contextlib.suppress(RuntimeError, asyncio.CancelledError):  # the server stops meanwhile
                    await asyncio.shield(self.do(self.environment.delete, client.viewer))
                self.went_on()
            writer.close()

    async def do(self, act: Callable[..., Result], *arguments: Any) -> Result:
        """What `act` gives, in the thread of the world."""
        return await asyncio.get_running_loop().run_in_executor(self._world, act, *arguments)

    async def frame(self, viewer: AgentCamera, wanted: list[str]) -> tuple[dict[str, Any], float]:
        """An agent's next frame, when those that take frames have had the current one, or were given time for it."""
        loop = asyncio.get_running_loop()
        deadline = loop.time() + self.wait
        while True:
            progress = self._progress  # before looking who is behind, so that nothing is missed in between
            behind = await self.do(self.environment.behind, viewer)
            if not behind:
                break
            try:
                async with asyncio.timeout_at(deadline):
                    await progress.wait()
            except TimeoutError:
                for each in behind:
                    each.stepping = False
        result = await self.do(self.environment.frame, viewer, wanted)
        self.went_on()
        return result

    def went_on(self) -> None:
        """Wake those who wait for others."""
        self._progress.set()
        self._progress = asyncio.Event()

# SPDX-License-Identifier: Apache-2.0
"""`tiscene serve`: serve SAILenv clients over TCP."""

from __future__ import annotations

import argparse
import asyncio
import logging

from tiscene.cli.terminal import note
from tiscene.errors import ArgumentError
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.server import Server


def run(args: argparse.Namespace) -> None:
    """Serve until interrupted; print the address once clients can connect."""
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(args.verbose, 2)]
    logging.basicConfig(level=level, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    logging.getLogger("asyncio").setLevel(logging.ERROR)
    if not 0 <= args.port <= 65535:
        raise ArgumentError(f"--port {args.port}: must be from 0 to 65535")
    if not args.wait >= 0.0:
        raise ArgumentError(f"--wait {args.wait}: must be 0 s or more")
    worlds = AgentWorlds(
        args.scene,
        together=args.together,
        world=args.world,
        fps=args.fps,
        quality=args.quality,
        spp=args.spp,
        incremental=args.incremental,
        seed=args.seed,
        consecutive_flow=args.consecutive_flow,
        query_budget=args.query_budget,
        keep_clock=args.keep_clock,
        physics=args.physics,
        arch=args.arch,
    )
    server = Server(worlds, args.host, args.port, wait=args.wait)
    try:
        asyncio.run(server.run(lambda host, port: print(f"listening on {host}:{port}", flush=True)))
    except OSError as error:
        raise ArgumentError(f"cannot listen on {args.host}:{args.port}: {error.strerror or error}") from error
    note("stopped")

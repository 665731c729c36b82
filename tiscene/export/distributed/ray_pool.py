# SPDX-License-Identifier: Apache-2.0
"""RayPool: workers on the nodes of a Ray cluster. Nodes may come and go during a run."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiscene.errors import DeviceError, counted, requires_extra
from tiscene.export.distributed.ray_worker import Outcome, RayWorker
from tiscene.export.distributed.task_loop import PoolEvent, Work

NODE_INTERVAL = 2.0  # s between two looks at the nodes
MAX_STARTS = 3  # of workers on one node that are lost before they are ready
GRACE = 5.0  # s that workers have to save their manifests when a run is stopped
OBJECT_STORE = 100 << 20  # bytes, of a local cluster: next to nothing is kept in it
ENVIRONMENT = ("TISCENE_PATH", "TISCENE_CACHE")  # variables of the caller that workers get too


@contextlib.contextmanager
def connected(address: str | None) -> Iterator[None]:
    """Connect to a Ray cluster, unless this process is connected already; disconnect at the end.

    Args:
        address: "host:port" or "ray://host:port"; "local" for a cluster of this machine alone; None for that in
            RAY_ADDRESS, else the one running on this machine, else "local".

    Raises:
        MissingExtra: Ray is not installed.
        DeviceError: There is no such cluster.
    """
    with requires_extra("ray"):
        import ray
    if ray.is_initialized():
        yield
        return
    options = {"log_to_driver": False, "logging_level": logging.ERROR}
    local = {"object_store_memory": OBJECT_STORE, "include_dashboard": False}
    try:
        if address == "local":
            ray.init(address="local", **local, **options)
        else:
            try:
                ray.init(address=address or "auto", **options)
            except ConnectionError:
                if address is not None or os.environ.get("RAY_ADDRESS"):
                    raise
                ray.init(address="local", **local, **options)
    except (ConnectionError, RuntimeError, ValueError) as error:
        where = address or os.environ.get("RAY_ADDRESS") or "local"
        raise DeviceError(f"cannot connect to a Ray cluster at {where!r}: {str(error).splitlines()[0]}") from error
    try:
        yield
    finally:
        ray.shutdown()


@dataclass
class _Member:
    """A worker: its actor, its node, and what it does now."""

    actor: Any
    node: str
    pending: Any  # the reference of the call that runs; None: idle
    is_open: bool = False


class RayPool:
    """Workers on all nodes of the connected cluster: one a node, or one a GPU.

    Args:
        work: What they do; sent to each.
        run_file: A file in the shared folder; see RayWorker.
        arch: "cuda" for a worker per GPU, else a worker per node.
        cpus: Processors of each worker; None for all of its node, or its share of them beside each GPU.
    """

    def __init__(self, work: Work, run_file: Path, *, arch: str | None, cpus: int | None) -> None:
        import ray

        self._work, self._run_file = ray.put(work), run_file
        self._on_gpus, self._cpus = arch == "cuda", cpus
        self._members: dict[str, _Member] = {}
        self._names = itertools.count(1)
        self._failed_starts: Counter[str] = Counter()
        self._excluded: dict[str, str] = {}  # the reason, by the node's id
        self._looked_at = float("-inf")

    def __enter__(self) -> RayPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start_workers(self) -> None:
        """Start workers on nodes that have none, such as nodes that have joined or whose worker was lost."""
        import ray

        if time.monotonic() - self._looked_at < NODE_INTERVAL:
            return
        nodes = {node["NodeID"]: node for node in ray.nodes() if node["Alive"]}
        first, self._looked_at = self._looked_at == float("-inf"), time.monotonic()
        slots = {id: self._slots(node["Resources"]) for id, node in nodes.items()}
        if first and not any(count for count, _ in slots.values()):
            wanted = "a GPU" if self._on_gpus else counted(self._cpus or 1, "processor")
            raise DeviceError(f"no node of the Ray cluster ({len(nodes)} in all) has {wanted}")
        present = Counter(member.node for member in self._members.values())
        for id, (count, cpus) in slots.items():
            if id not in self._excluded:
                for _ in range(count - present[id]):
                    self._start(id, nodes[id]["NodeManagerAddress"], cpus)
        if self._excluded and not self._members:
            reason = next(iter(self._excluded.values()))
            raise DeviceError(f"workers cannot be started on any node: {reason}")

    def wait(self, timeout: float) -> list[PoolEvent]:
        """Return what has happened since the last call; wait for something up to `timeout` seconds."""
        import ray

        names = {member.pending: name for name, member in self._members.items() if member.pending is not None}
        if not names:
            time.sleep(timeout)
            return []
        first, _ = ray.wait(list(names), num_returns=1, timeout=timeout)
        ready, _ = ray.wait(list(names), num_returns=len(names), timeout=0) if first else ([], [])
        return [self._event(names[reference], reference) for reference in ready]

    def submit(self, worker: str, task: int) -> None:
        """Give a worker a task."""
        member = self._members[worker]
        member.pending = member.actor.run.remote(task)

    def stop(self) -> None:
        """End all workers; those that run may finish their frame, if they see that the run's file is gone."""
        import ray

        running = [member.pending for member in self._members.values() if member.pending is not None and member.is_open]
        with contextlib.suppress(Exception):
            if running:
                ray.wait(running, num_returns=len(running), timeout=GRACE)
        for name in list(self._members):
            self._remove(name)

    def _slots(self, resources: Mapping[str, float]) -> tuple[int, int]:
        """Return the number of workers of a node, and the processors of each."""
        processors = int(resources.get("CPU", 0))
        if self._on_gpus:
            gpus = int(resources.get("GPU", 0))
            each = self._cpus if self._cpus is not None else processors // max(1, gpus)
            return (min(gpus, processors // each) if each else gpus), each
        each = self._cpus if self._cpus is not None else processors
        return (processors // each if each else 0), each

    def _start(self, node: str, address: str, cpus: int) -> None:
        """Start a worker on a node."""
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        environment = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
        environment["TI_CPU_MAX_NUM_THREADS"] = str(max(1, cpus))
        actor = (
            ray.remote(RayWorker)
            .options(
                num_cpus=cpus,
                num_gpus=int(self._on_gpus),
                max_restarts=0,  # a lost worker is replaced here, and its task handed out again
                scheduling_strategy=NodeAffinitySchedulingStrategy(node, soft=False),
            )
            .remote(self._work, self._run_file, Path.cwd(), environment)
        )
        name = f"worker {next(self._names)} on {address}"
        self._members[name] = _Member(actor, node, actor.open.remote())

    def _event(self, name: str, reference: Any) -> PoolEvent:
        """Return what the end of a worker's call means."""
        import ray

        member = self._members[name]
        member.pending = None
        try:
            outcome: Outcome = ray.get(reference)
        except ray.exceptions.RayError as error:
            reason = " ".join(str(error).split())
            self._remove(name)
            if not member.is_open:
                self._note_failed_start(member.node, name, reason)
            return PoolEvent(name, "lost", reason=reason)
        if outcome.opened is not None:
            member.is_open = True
            return PoolEvent(name, "opened", opened=outcome.opened, warnings=outcome.warnings)
        if not member.is_open:  # not for want of this node alone: the caller's arguments, the scene, the folder
            raise DeviceError(f"{name}: {outcome.error}")
        if outcome.error:
            return PoolEvent(name, "failed", reason=outcome.error, warnings=outcome.warnings)
        return PoolEvent(name, "done", warnings=outcome.warnings)

    def _note_failed_start(self, node: str, name: str, reason: str) -> None:
        """Use a node no more if its workers are lost again and again before they are ready."""
        self._failed_starts[node] += 1
        if self._failed_starts[node] >= MAX_STARTS and node not in self._excluded:
            self._excluded[node] = f"{name}: {reason}"
            warnings.warn(f"the node of {name} is not used: {reason}", RuntimeWarning, stacklevel=2)

    def _remove(self, name: str) -> None:
        """End a worker and forget it."""
        import ray

        member = self._members.pop(name)
        self._looked_at = min(self._looked_at, time.monotonic() - NODE_INTERVAL)  # a new worker is started at once
        with contextlib.suppress(Exception):
            ray.kill(member.actor)

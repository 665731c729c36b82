# SPDX-License-Identifier: Apache-2.0
"""Row "interrupts": Ctrl-C at random moments of every command, as a terminal sends it: to all processes of the command.

After each, the command ends within 2 s of wall time, says so in one line, and leaves no process and no torn file.
Commands that write are then run to their end: the bytes are those of an undisturbed run. On a busy machine, the 2 s are
multiplied by what a small computation takes longer there than its CPU time, before or after.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from tests.stress.child_process import ROOT
from tests.stress.killed_processes import KILLS_PER_FOLDER, cold_caches, contents, torn_files, write_model
from tests.stress.outcomes import Outcome, count
from tiscene.export.shards import FILE as SHARD_FILE
from tiscene.export.shards import SHARDS

ALLOWED = 2.0  # s until a command has ended, on a quiet machine
LINGERS = 1.0  # s in which the last of its processes ends after it
HANGS = 120.0  # s after which it is killed
ENDED = {0, 130, -signal.SIGINT}  # it was done, it stopped, or the interpreter itself was interrupted at its start
SIZE = ("--width", "32", "--height", "24")


class Interrupted(NamedTuple):
    """How a command ended after Ctrl-C.

    Attributes:
        seconds: Wall time that it took to end; None if it was killed after HANGS.
        allowed: What it may take, at the load of the machine, s.
        status: Exit status.
        errors: What it wrote to stderr.
        hit: Whether it was still running.
        left: Command lines of its processes that still ran afterwards.
    """

    seconds: float | None
    allowed: float
    status: int
    errors: str
    hit: bool
    left: tuple[str, ...] = ()


def launch(arguments: Sequence[str], env: dict[str, str]) -> subprocess.Popen[str]:
    """Start a command of tiscene in a process group of its own."""
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True, "errors": "replace"}
    command = [sys.executable, "-W", "ignore", "-m", "tiscene", *arguments]
    # As installed packages have it.
    bytecode = str(Path(tempfile.gettempdir(), "tiscene-stress-bytecode"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONPYCACHEPREFIX": bytecode, **env}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return subprocess.Popen(command, env=environment, cwd=ROOT, start_new_session=True, **pipes)


def run(arguments: Sequence[str], env: dict[str, str]) -> float:
    """Run a command to its end and return how long it took, s.

    Raises:
        RuntimeError: It failed.
    """
    began = time.monotonic()
    with launch(arguments, env) as process:
        _, errors = process.communicate(timeout=600)
    if process.returncode:
        raise RuntimeError(f"tiscene {arguments[0]}: exit status {process.returncode}: {errors.strip()[-300:]}")
    return time.monotonic() - began


def interrupt(arguments: Sequence[str], env: dict[str, str], delay: float) -> Interrupted:
    """Start a command and press Ctrl-C after a delay, s."""
    with launch(arguments, env) as process:
        try:
            process.communicate(timeout=delay)
            return Interrupted(0.0, ALLOWED, process.returncode, "", hit=False)
        except subprocess.TimeoutExpired:
            before = slowdown()
            os.killpg(process.pid, signal.SIGINT)
        began = time.monotonic()
        try:
            _, errors = process.communicate(timeout=HANGS)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return Interrupted(None, ALLOWED, 0, process.communicate()[1], hit=True)
        seconds = time.monotonic() - began
        allowed = ALLOWED * max(before, slowdown())
        end = time.monotonic() + LINGERS * allowed / ALLOWED
        output = arguments[arguments.index("-o") + 1] if "-o" in arguments else None
        while (left := running(process.pid, output)) and time.monotonic() < end:
            time.sleep(0.05)
        return Interrupted(seconds, allowed, process.returncode, errors, hit=True, left=left)


def slowdown() -> float:
    """Return how many times as long as its CPU time a small computation takes, at least 1."""
    wall, cpu, total = time.perf_counter(), time.thread_time(), 0
    while time.thread_time() - cpu < 0.05:
        total += sum(range(1000))
    return max(1.0, (time.perf_counter() - wall) / (time.thread_time() - cpu))


def running(group: int, output: str | None) -> tuple[str, ...]:
    """Return the command lines of processes of a group, and of tiscene's processes that write into a folder."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, _, number = (folder / "stat").read_text().rpartition(")")[2].split()[:3]
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except OSError:  # it has ended meanwhile
            continue
        if state != "Z" and (int(number) == group or (output in words and "tiscene" in words)):
            found.append(" ".join(words))
    return tuple(found)


def unsharded(found: dict[str, bytes]) -> dict[str, bytes]:
    """Return the files of an output folder, those of unfinished shards by the names that they will have."""
    names = {name: re.sub(f"^{SHARDS}/[^/]+/", "", name) for name in found}
    return {names[name]: data for name, data in found.items() if names[name] != SHARD_FILE}


def faults(found: Interrupted, delay: float) -> list[str]:
    """Return what is wrong with how a command ended."""
    when = f"at {delay:.2f} s"
    if found.seconds is None:
        return [f"{when}: it did not end in {HANGS:.0f} s"]
    wrong = []
    if found.seconds > found.allowed:
        wrong.append(f"{when}: it took {found.seconds:.1f} s, {found.allowed:.1f} s are allowed at this load")
    if found.left:
        wrong.append(f"{when}: still running: {found.left[0]}")
    if found.status not in ENDED:
        wrong.append(f"{when}: exit status {found.status}")
    # The first tenths of a second belong to the interpreter, which prints a traceback of its own.
    if found.status == 130 and "Traceback" in found.errors:
        wrong.append(f"{when}: {found.errors.strip().splitlines()[-1]}")
    return wrong


def interrupt_often(
    use: str, arguments: Sequence[str], number: int, folder: Path, *, output: bool, cold: bool = False, seed: int = 0
) -> Outcome:
    """Interrupt a command at random moments, from its start to its end.

    Args:
        use: Name of the use.
        arguments: Of the command, without -o.
        number: How often.
        folder: An empty folder.
        output: Whether the command writes into a folder; it is resumed there after each interrupt.
        cold: Whether each folder has caches of its own, empty at first.
        seed: Of the moments.
    """
    rng, times, late, wrong, torn, different, hit = random.Random(seed), [0.0], 0, [], [], 0, 0

    def into(name: str) -> tuple[str, ...]:
        return (*arguments, "-o", str(folder / name)) if output else tuple(arguments)

    env = cold_caches(folder / "caches") if cold else {}
    longest = run(into("whole"), env)
    if not cold:
        longest = run(into("again"), env)  # the first run may have compiled kernels
    whole = contents(folder / "whole") if output else {}
    groups = -(-number // KILLS_PER_FOLDER)
    for group in range(groups):
        name = f"interrupted_{group}"
        env = cold_caches(folder / f"caches_{group}") if cold else {}
        for _ in range(min(KILLS_PER_FOLDER, number - group * KILLS_PER_FOLDER)):
            delay = rng.uniform(0.0, longest)
            found = interrupt(into(name), env, delay)
            hit += found.hit
            times.append(found.seconds or 0.0)
            late += times[-1] > ALLOWED
            wrong += faults(found, delay)
            if (folder / name).exists():
                torn += torn_files(unsharded(contents(folder / name)), whole)
        if output:
            run(into(name), env)
            different += contents(folder / name) != whole
            different += any(path.name.endswith(".part") for path in (folder / name).rglob("*"))
    median = sorted(times[1:])[len(times) // 2 - 1]
    figures = f"{hit} hit it at work; ended after {median:.2f} s (median) to {max(times):.2f} s, {late} after 2 s"
    if output:
        figures += f"; {len(torn)} torn files {torn[:2] or ''}; {different} of {groups} resumed folders differ"
    if wrong:
        figures += f"; {len(wrong)} wrong: {'; '.join(wrong[:3])}"
    return Outcome(f"Ctrl-C at {number} random moments of {use}", figures, hit > 0 and not (wrong or torn or different))


SCENARIO, MODEL = "scenario.json", "model"
FRAMES = ("render", SCENARIO, *SIZE, "--quality", "fast", "--frames", "0:24")


class Use(NamedTuple):
    """A command to interrupt.

    Attributes:
        name: Of the use.
        arguments: Of the command; SCENARIO and MODEL stand for paths.
        full: How often at scale 1.
        output, cold: See `interrupt_often`.
    """

    name: str
    arguments: tuple[str, ...]
    full: int
    output: bool = True
    cold: bool = False


USES = {
    "render": Use("`tiscene render`", FRAMES, 50),
    "workers": Use("`tiscene render --workers 2`", (*FRAMES, "--workers", "2"), 20),
    "cold": Use("`tiscene render` with cold caches", (*FRAMES[:-1], "0:2"), 20, cold=True),
    "npz": Use("`tiscene render --format npz`", (*FRAMES, "--format", "npz"), 20),
    "demo": Use(
        "`tiscene demo`", ("demo", "--frames", "2", "--width", "64", "--height", "48", "--quality", "fast"), 10
    ),
    "import": Use("`tiscene import`", ("import", MODEL, "--name", "Grid"), 20),
    "inspect": Use("`tiscene inspect`", ("inspect", "room_02"), 10, output=False),
    "show": Use("`tiscene show`", ("show", "room_02"), 10, output=False),
    "list": Use("`tiscene list`", ("list",), 10, output=False),
    "bench": Use("`tiscene bench`", ("bench", "object_view", "--seconds", "0.01"), 10, output=False),
}


def rows(scale: float, use: str | None = None) -> Iterator[Outcome]:
    """Run the row, or one of USES; scale 1 is the full count."""
    with tempfile.TemporaryDirectory(prefix="tiscene-stress-") as name:
        folder = Path(name)
        from tests.stress.steady_state import scenario

        scenario().save(folder / SCENARIO)
        paths = {SCENARIO: str(folder / SCENARIO), MODEL: str(write_model(folder / MODEL))}
        for seed, (key, each) in enumerate(USES.items()):
            if use in (None, key):
                own, arguments = folder / key, [paths.get(word, word) for word in each.arguments]
                own.mkdir()
                number = count(each.full, scale, 2)
                yield interrupt_often(each.name, arguments, number, own, output=each.output, cold=each.cold, seed=seed)

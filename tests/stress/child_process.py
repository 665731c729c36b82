# SPDX-License-Identifier: Apache-2.0
"""Call functions in new Python processes, with a time limit, and read their results as JSON."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
MARK = "result: "
_PROGRAM = f"""
import importlib, json, sys
module, function, arguments = sys.argv[1:]
result = getattr(importlib.import_module(module), function)(*json.loads(arguments))
print({MARK!r} + json.dumps(result), flush=True)
"""


class ChildFailed(Exception):
    """A child process ended with an error, or without a result.

    Attributes:
        status: Exit status; negative for a signal, None after the time limit.
        errors: What it wrote to stderr.
    """

    def __init__(self, status: int | None, errors: str) -> None:
        last = errors.strip().splitlines()[-1:] or ["nothing on stderr"]
        super().__init__(f"exit status {status}: {last[0]}")
        self.status, self.errors = status, errors


def start(function: str, *arguments: Any, env: Mapping[str, str | None] | None = None) -> subprocess.Popen[str]:
    """Start a process that calls a function.

    Args:
        function: "module:name".
        arguments: Its arguments, JSON values.
        env: Changes of the environment; None removes a variable.

    Returns:
        The process, the leader of a new process group. The last line of its stdout is MARK and the result as JSON.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore", **(env or {})}
    environment = {name: value for name, value in environment.items() if value is not None}
    command = [sys.executable, "-c", _PROGRAM, *function.split(":"), json.dumps(arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "errors": "replace"}
    return subprocess.Popen(command, env=environment, start_new_session=True, cwd=ROOT, **pipes)


def result_of(process: subprocess.Popen[str], seconds: float = 600.0) -> Any:
    """Wait for a process of `start` and return the result.

    Raises:
        ChildFailed: It ended with an error, by a signal, or exceeded the time limit.
    """
    with process:
        try:
            output, errors = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            kill_group(process)
            _, errors = process.communicate()
            raise ChildFailed(None, errors) from None
    lines = output.splitlines()
    if process.returncode or not lines or not lines[-1].startswith(MARK):
        raise ChildFailed(process.returncode, errors)
    return json.loads(lines[-1].removeprefix(MARK))


def call(function: str, *arguments: Any, env: Mapping[str, str | None] | None = None, seconds: float = 600.0) -> Any:
    """Call a function in a new process and return its result. Raises ChildFailed."""
    return result_of(start(function, *arguments, env=env), seconds)


def kill_after(process: subprocess.Popen[str], delay: float, number: int = signal.SIGKILL) -> bool:
    """Send a signal to the process group after a delay, s. Return False if the process ended before."""
    try:
        process.communicate(timeout=delay)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, number)
        return True


def kill_group(process: subprocess.Popen[str]) -> None:
    """Kill a process of `start` and its children."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)

# SPDX-License-Identifier: Apache-2.0
"""Run programs in processes of their own."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run_python(code: str, *arguments: str, env: Mapping[str, str | None] | None = None, warn: str = "ignore") -> str:
    """Run a program and return what it prints.

    Args:
        code: The program, or the path of a file that ends with .py.
        arguments: Its arguments.
        env: Changes of the environment; None removes a variable.
        warn: What Python does with warnings.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **(env or {})}
    environment = {name: value for name, value in environment.items() if value is not None}
    program = [code] if code.endswith(".py") else ["-c", code]
    command = [sys.executable, "-W", warn, *program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, f"exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout.strip()

# SPDX-License-Identifier: Apache-2.0
"""Run hard use and print a table: `python -m tests.stress [ROW[:USE] ...] [--scale S]`.

A row with a use, such as memory:labels, runs this one alone. --scale multiplies all counts: 1 (default) runs hours,
0.01 minutes. Exit status 1 if something did not hold.
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import signal
import sys
import time
from collections.abc import Sequence

from tests.stress.outcomes import HEADER, Outcome, table_line

# Rows of docs/dev/hard-use.md, and the modules whose function `rows(scale)` runs them. If a module has a table USES,
# `rows(scale, use)` runs one of its keys alone.
ROWS = {
    "memory": "steady_state",
    "kills": "killed_processes",
    "storage": "unwritable_storage",
    "files": "mutated_files",
    "server": "server_attacks",
    "big": "extreme_scenes",
    "threads": "concurrent_streams",
    "interrupts": "interrupted_commands",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run rows and print the table.

    Args:
        arguments: Command-line arguments; None for those of this process.

    Returns:
        The exit status: 0, 1 if something did not hold, 2 for an unknown row or use.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.stress", description="Hard use, and figures of it.")
    parser.add_argument("rows", metavar="ROW[:USE]", nargs="*", help=f"to run (default: all): {', '.join(ROWS)}")
    parser.add_argument("--scale", type=float, default=1.0, help="multiplies all counts (default: 1)")
    args = parser.parse_args(arguments)
    for name in args.rows:
        wrong = unknown(name)
        if wrong:
            print(wrong, file=sys.stderr)
            return 2
    print(f"{platform.machine()}, {os.cpu_count()} logical cores, scale {args.scale:g}\n\n{HEADER}", flush=True)
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # in the background of a shell it is ignored, by children too
    held = True
    for name in args.rows or ROWS:
        began = time.monotonic()
        row, _, use = name.partition(":")
        module = importlib.import_module(f"tests.stress.{ROWS[row]}")
        try:
            for outcome in module.rows(args.scale, use) if use else module.rows(args.scale):
                print(table_line(row, outcome), flush=True)
                held = held and outcome.held
        except Exception as error:  # a defect of the program itself must not hide the other rows
            print(table_line(row, Outcome("the program itself", repr(error), False)), flush=True)
            held = False
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr)
    return int(not held)


def unknown(name: str) -> str:
    """Return why a name is not a row, or not a row and its use; "" if it is."""
    row, _, use = name.partition(":")
    if row not in ROWS:
        return f"no row {row!r}; known: {', '.join(ROWS)}"
    uses = getattr(importlib.import_module(f"tests.stress.{ROWS[row]}"), "USES", {})
    if use and use not in uses:
        return f"row {row!r} has no use {use!r} that runs alone; known: {', '.join(uses) or 'none'}"
    return ""


if __name__ == "__main__":
    sys.exit(main())

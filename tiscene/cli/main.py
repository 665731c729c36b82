# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command `tiscene`.

Exit status: 0 success, 1 closed output pipe, 2 user error (explained on stderr), 130 interrupted. Commands are imported
when they run, so that `tiscene --help` is fast.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from tiscene.cli.parser import parser
from tiscene.errors import StageWarning, TisceneError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        arguments: Command-line arguments; None for those of this process.

    Returns:
        The exit status.
    """
    top = parser()
    args = top.parse_args(arguments)
    args.arguments = list(sys.argv[1:] if arguments is None else arguments)  # for worker processes
    if args.command is None:
        top.print_help(sys.stderr)
        return 2
    with warnings.catch_warnings():
        warnings.simplefilter("always", StageWarning)
        warnings.showwarning = _show_warning
        try:
            with _interrupts_of_imports(exit_at_once=arguments is None):
                command = importlib.import_module(f"tiscene.cli.{args.command}")
            command.run(args)
            sys.stdout.flush()
        except TisceneError as error:
            print(f"tiscene: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("tiscene: interrupted", file=sys.stderr)
            return 130
        except BrokenPipeError:
            # For example `tiscene list | head`. Without this, Python reports the closed pipe once more at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
    return 0


@contextmanager
def _interrupts_of_imports(exit_at_once: bool) -> Iterator[None]:
    """Handle interrupts of a block that imports modules: the C++ code of pxr would swallow a KeyboardInterrupt.

    Args:
        exit_at_once: end the process, which has done nothing yet; otherwise raise KeyboardInterrupt after the block.
    """
    default = signal.default_int_handler
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is not default:
        yield
        return
    received: list[int] = []

    def interrupt(number: int, _: object) -> None:
        if exit_at_once:
            os.write(2, b"tiscene: interrupted\n")
            os._exit(130)
        received.append(number)

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, default)
    if received:
        raise KeyboardInterrupt


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning as one line, without its place in the source code."""
    print(f"tiscene: warning: {message}", file=sys.stderr)

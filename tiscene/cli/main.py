# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command `tiscene`.

Exit status: 0 success, 1 the reader closed the pipe, 2 a user error explained by the message, 130 interrupted.
Commands are imported when they run, so that `tiscene --help` is instant.
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
    """Run the command line (default: this process's); return the exit status."""
    top = parser()
    args = top.parse_args(arguments)
    if args.command is None:
        top.print_help(sys.stderr)
        return 2
    with warnings.catch_warnings():
        warnings.simplefilter("always", StageWarning)
        warnings.showwarning = _show_warning
        try:
            with _interrupts_later():
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
            # The reader has left (`tiscene list | head`). Python would complain once more at its own end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
    return 0


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Ctrl-C inside counts at the end: while pxr is imported, its C++ would swallow it."""
    usual = signal.default_int_handler
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    if came:
        raise KeyboardInterrupt


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """One line, without the place in our source that Python would add."""
    print(f"tiscene: warning: {message}", file=sys.stderr)

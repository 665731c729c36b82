# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command `tiscene`.

Exit status: 0 success, 1 closed output pipe, 2 user error (explained on stderr), 3 scenarios of a data set have errors
(the others are made), 130 interrupted, 143 terminated (or ended by SIGINT or SIGTERM, which shells show so). Commands
are imported when they run: `tiscene --help` is fast.
"""

from __future__ import annotations

import errno
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any

from dynamics.argument_checks import is_unicode
from tiscene.cli import interruption
from tiscene.cli.parser import parser
from tiscene.errors import StageWarning, TisceneError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        arguments: Command-line arguments; None for those of this process, which is then the command's own.

    Returns:
        The exit status.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal without a character, such as "²", shows "?"
            stream.reconfigure(errors="replace")
    top = parser()
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    own, script_arguments = command_line, []
    if command_line[:1] == ["sailenv"] and "--" in command_line:  # argparse takes them only right after the script
        end = command_line.index("--")
        own, script_arguments = command_line[:end], command_line[end + 1 :]
    args = top.parse_args(own)
    args.command_line, args.script_arguments = command_line, script_arguments
    for each in own:
        if not is_unicode(each):
            print(_not_text(each), file=sys.stderr)
            return 2
    if args.command is None:
        top.print_help(sys.stderr)
        return 2
    owns_process = arguments is None
    if owns_process and args.command != "sailenv":  # which runs a script of the user's, that may handle Ctrl-C itself
        is_worker, on_cluster = (getattr(args, name, None) is not None for name in ("shard", "ray"))
        grace = interruption.CLUSTER_GRACE if on_cluster else interruption.GRACE
        interruption.end_after_interrupt(interruption.WORKER_GRACE if is_worker else grace)
    with warnings.catch_warnings():
        warnings.simplefilter("always", StageWarning)
        warnings.showwarning = partial(_show_warning, set())
        try:
            with interruption.imports(exit_at_once=owns_process):
                command = importlib.import_module(f"tiscene.cli.{args.command}")
            status: int = command.run(args) or 0
            if sys.stdout is not None:  # a program may start the command without one
                sys.stdout.flush()
        except TisceneError as error:
            print(f"tiscene: {error}", file=sys.stderr)
            return 2
        except UnicodeEncodeError as error:  # of the name of a file, in a process that is not of UTF-8
            if sys.getfilesystemencoding() == "utf-8":
                raise
            print(_not_text(error.object), file=sys.stderr)
            return 2
        except KeyboardInterrupt as error:
            interruption.say_interrupted()
            return 143 if isinstance(error, interruption.Terminated) else 130
        except OSError as error:
            # For example `tiscene list | head` or `tiscene list > /dev/full`. Errors of named files are not expected.
            if error.filename is not None or error.errno not in (errno.EPIPE, errno.ENOSPC):
                raise
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python would report it once more at exit
            if error.errno == errno.EPIPE:
                return 1
            print("tiscene: the output cannot be written: no space left on its device", file=sys.stderr)
            return 2
    return status


def _not_text(name: str) -> str:
    """Return the message about a name of a file that this process cannot read or write."""
    encoding = sys.getfilesystemencoding()
    advice = "rename it" if encoding == "utf-8" else "set the environment variable PYTHONUTF8=1, or LC_ALL=C.UTF-8"
    return f"tiscene: {name!r} is not text in the encoding {encoding}: {advice}"


def _show_warning(shown: set[str], message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning once, without its place in the source code. `worker_processes` reads it."""
    if str(message) not in shown:
        shown.add(str(message))
        print(f"tiscene: warning: {message}", file=sys.stderr)

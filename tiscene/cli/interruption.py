# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM end a command within two seconds, whatever it is doing; one that runs on a cluster within 15.

Python acts on a signal when its main thread executes Python code again. While Taichi compiles a kernel, that can take
many seconds, and no other thread runs either, since the compiler holds the interpreter's lock. Therefore a small
process beside the command waits for the signal. It leaves the command some time to end by itself, and then ends it.
Nothing is lost by that: files have temporary names until they are complete, and a lock on a folder ends with its
process.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence

GRACE = 1.4  # s, in which a command may end by itself after the signal
WORKER_GRACE = 0.8  # s, of a process that renders a part for another command, which waits for its end
PARENT = "TISCENE_WORKER_OF"  # environment variable of such a process: the id of the other command
PARENT_INTERVAL = 0.2  # s, between looks at whether that command still runs
CLUSTER_GRACE = 15.0  # s, of a command that stops workers on other machines; a second Ctrl-C ends it at once
_LAST = 0.2  # s, in which the system ends a process after a second signal
_MESSAGE = b"tiscene: interrupted\n"
_SAID = b"\xff"  # no number of a signal

_pipe: int | None = None  # to the watching process
_numbers: tuple[int, ...] = ()  # the signals after which it ends this process


class Terminated(KeyboardInterrupt):
    """SIGTERM, which schedulers send: a command ends as after Ctrl-C, and says the same."""


def end_after_interrupt(grace: float = GRACE) -> None:
    """Let Ctrl-C and SIGTERM end this process after some time at the latest. Call it once, before threads are started.

    Does nothing where processes cannot be forked (Windows), nor for a signal that is ignored or that other code
    handles. A worker of another command is interrupted when that command has ended in any way: given again, the same
    command would find folders locked that the worker writes into. SIGTERM kills it, and that command starts it again.

    Args:
        grace: The time, s.
    """
    global _pipe, _numbers
    parent = os.environ.pop(PARENT, None)
    if parent is not None:  # only the parent interrupts it, also where the parent itself ignores SIGINT, as by nohup
        signal.signal(signal.SIGINT, signal.default_int_handler)
    is_main = threading.current_thread() is threading.main_thread()
    interrupts = (signal.SIGINT,) if _has_default_handler() else ()
    terminates = is_main and parent is None and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    numbers = (*interrupts, signal.SIGTERM) if terminates else interrupts
    if not (hasattr(os, "fork") and numbers):
        return
    watched = os.getpid()
    reader, writer = os.pipe()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    watcher = os.fork()
    if watcher == 0:
        try:
            os.close(writer)
            _watch(reader, watched, grace, numbers)
        finally:
            os._exit(0)
    os.close(reader)
    os.set_blocking(writer, False)
    _pipe, _numbers = writer, numbers
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)  # the C code of the signal handler writes to it
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    os.register_at_fork(after_in_child=_close)
    atexit.register(_release, watcher)  # runs after the functions that are registered later
    if parent is not None:
        threading.Thread(target=_interrupt_without, args=(int(parent),), daemon=True).start()


def _interrupt_without(parent: int) -> None:
    """Interrupt this process when its parent is no longer the given one."""
    while os.getppid() == parent:
        time.sleep(PARENT_INTERVAL)
    os.kill(os.getpid(), signal.SIGINT)


def say_interrupted() -> None:
    """Tell the user that the command was interrupted."""
    print(_MESSAGE.decode(), end="", file=sys.stderr, flush=True)
    if _pipe is not None:
        atexit.unregister(_release)  # the end of the interpreter is watched too
        with contextlib.suppress(OSError):
            os.write(_pipe, _SAID)


@contextlib.contextmanager
def imports(exit_at_once: bool) -> Iterator[None]:
    """Handle interrupts of a block that imports modules: the C++ code of pxr would swallow a KeyboardInterrupt.

    Args:
        exit_at_once: End the process, which has done nothing yet; otherwise raise KeyboardInterrupt after the block.
    """
    if not _has_default_handler():
        yield
        _handle_termination()
        return
    received: list[int] = []

    def interrupt(number: int, _: object) -> None:
        if exit_at_once:
            os.write(2, _MESSAGE)
            os._exit(130)
        received.append(number)

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if _pipe is not None:
            _end_at_second_signal(signal.SIGINT)
    _handle_termination()
    if received:
        raise KeyboardInterrupt


def _has_default_handler() -> bool:
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler


def _handle_termination() -> None:
    """Raise Terminated at SIGTERM, if the watching process ends this one after it."""
    if signal.SIGTERM in _numbers:
        signal.signal(signal.SIGTERM, _raise_terminated)
        _end_at_second_signal(signal.SIGTERM)


def _raise_terminated(number: int, frame: object) -> None:
    raise Terminated


def _end_at_second_signal(number: int) -> None:
    """Keep Python's handler of a signal for one time; at the next one the system ends this process.

    Without this function of the C library, a second signal is handled like the first.
    """
    handle_once = getattr(ctypes.CDLL(None), "sysv_signal", None)
    if handle_once is not None:
        handle_once.argtypes, handle_once.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_void_p
        handler = handle_once(number, None)  # Python's
        handle_once(number, handler)


def _watch(reader: int, watched: int, grace: float, numbers: Sequence[int]) -> None:
    """End a process some time after it was interrupted. Return when it has ended.

    Args:
        reader: Of the pipe to which its signal handler writes numbers of signals. It closes when the process ends.
        watched: The process, which is the parent of this one.
        grace: The time, s.
        numbers: The signals that interrupt it.
    """
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a scheduler sends it to this process too
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 0)
    os.dup2(nowhere, 1)
    received = bytearray(64)  # an exception loses what `os.read` returns
    with contextlib.suppress(KeyboardInterrupt):  # a terminal sends the signal to this process too
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        while not any(number in received for number in numbers):
            if not os.readv(reader, [received]):
                return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ended, said = _wait(reader, grace)
    if ended:
        return
    if not said and _SAID not in received:  # on a busy machine, both arrive at once
        with contextlib.suppress(OSError):
            os.write(2, _MESSAGE)
    second = signal.SIGTERM if signal.SIGTERM in received else signal.SIGINT  # see `_end_at_second_signal`
    for number in (second, signal.SIGKILL):
        if os.getppid() == watched:
            os.kill(watched, number)
        if _wait(reader, _LAST)[0]:
            return


def _wait(reader: int, seconds: float) -> tuple[bool, bool]:
    """Wait for the end of the process at the other end of a pipe.

    Returns:
        Whether it has ended, and whether it has said that it was interrupted.
    """
    end, said = time.monotonic() + seconds, False
    while (left := end - time.monotonic()) > 0.0:
        if select.select([reader], [], [], left)[0]:
            received = os.read(reader, 64)
            if not received:
                return True, said
            said = said or _SAID in received
    return False, said


def _close() -> None:
    """Close the pipe to the watching process."""
    global _pipe
    if _pipe is not None:
        signal.set_wakeup_fd(-1)
        os.close(_pipe)
        _pipe = None


def _release(watcher: int) -> None:
    """End the watching process, as this one is about to end."""
    for number in _numbers:
        signal.signal(number, signal.SIG_DFL)  # all is done
    _close()
    os.kill(watcher, signal.SIGKILL)
    os.waitpid(watcher, 0)

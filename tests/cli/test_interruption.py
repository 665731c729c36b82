# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C ends a command in time, also where Python cannot handle it."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from tiscene.cli import interruption

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
GRACE = 0.4
# A stand-in for the module of a command.
PROGRAM = f"""
import atexit, importlib, itertools, os, sys, time, types
from tiscene.cli import interruption
from tiscene.cli.main import main
interruption.GRACE = {GRACE}
def swallow():
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:  # as C++ code does that calls Python
            pass
def run(args):
    print("ready", flush=True)
    BODY
importlib.import_module = lambda name: types.SimpleNamespace(run=run)
sys.argv = ["tiscene", "list"]
sys.exit(main())
"""
NATIVE = "any(itertools.repeat(0))"  # C code without an end, which holds the interpreter's lock as compilers do


@pytest.fixture
def start():
    """Return a function that starts a command, the leader of a process group, and waits until it runs."""
    with contextlib.ExitStack() as commands:

        def start(body: str, *wrapper: str) -> subprocess.Popen[str]:
            program = PROGRAM.replace("BODY", body)
            command = subprocess.Popen(
                [*wrapper, sys.executable, "-c", program],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            commands.enter_context(command)
            commands.callback(command.kill)
            assert command.stdout.readline() == "ready\n"
            time.sleep(0.2)  # until BODY has begun
            return command

        yield start


def interrupt(command: subprocess.Popen[str], *, group: bool = True, number: int = signal.SIGINT) -> float:
    """Press Ctrl-C, or send another signal, and return how long the command took to end, s."""
    began = time.monotonic()
    if group:
        os.killpg(command.pid, number)
    else:
        command.send_signal(number)
    command.wait(30)
    return time.monotonic() - began


def errors(command: subprocess.Popen[str]) -> str:
    """Return what a command wrote to stderr, when no process of it is left that could write there."""
    return command.communicate(timeout=5.0)[1]


@pytest.mark.parametrize(
    ("group", "number"),
    [
        (True, signal.SIGINT),
        (False, signal.SIGTERM),
        pytest.param(True, signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(False, signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_interrupted_command_ends_at_once_with_one_line(start, number, group):
    command = start("time.sleep(60)")
    assert interrupt(command, group=group, number=number) < 5.0
    assert command.returncode == 128 + number
    assert errors(command) == "tiscene: interrupted\n"


@pytest.mark.parametrize(
    ("body", "group", "number"),
    [
        (NATIVE, True, signal.SIGINT),
        (NATIVE, False, signal.SIGTERM),
        ("swallow()", True, signal.SIGTERM),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (
                (NATIVE, True, signal.SIGTERM),
                (NATIVE, False, signal.SIGINT),
                ("swallow()", True, signal.SIGINT),
                ("swallow()", False, signal.SIGINT),
                ("swallow()", False, signal.SIGTERM),
            )
        ),
    ],
)
def test_command_ends_in_time_where_python_cannot_handle_the_signal(start, body, group, number):
    """Whether a terminal or a scheduler sends it, to the whole process group, or `kill`."""
    command = start(body)
    assert GRACE <= interrupt(command, group=group, number=number) < 5.0
    assert command.returncode == -number  # 130 or 143 in a shell
    assert errors(command) == "tiscene: interrupted\n"


def test_second_interrupt_ends_native_code_at_once(start):
    command = start(NATIVE)
    command.send_signal(signal.SIGINT)
    time.sleep(0.1)
    assert interrupt(command) < GRACE
    assert command.returncode == -signal.SIGINT


def test_command_that_hangs_at_its_exit_is_ended(start):
    command = start(f"atexit.register(lambda: {NATIVE}); time.sleep(60)")
    assert GRACE <= interrupt(command) < 5.0
    assert errors(command) == "tiscene: interrupted\n"


def test_command_that_waits_for_a_thread_at_its_exit_is_ended(start):
    body = "import threading; threading.Thread(target=time.sleep, args=(60,)).start(); time.sleep(60)"
    command = start(body)
    assert GRACE <= interrupt(command) < 5.0
    assert errors(command) == "tiscene: interrupted\n"


@pytest.mark.parametrize("body", ["pass", "os._exit(3)", "os.kill(os.getpid(), 9)"])
def test_nothing_is_left_of_a_command_that_has_ended(start, body):
    command = start(body)
    command.wait(30)
    assert command.returncode == {"pass": 0, "os._exit(3)": 3}.get(body, -9)
    assert errors(command) == ""


def test_message_that_arrives_together_with_the_signal_is_not_repeated():
    """On a busy machine, the watching process reads both at once."""
    program = (
        "import os, signal\n"
        "from tiscene.cli import interruption\n"
        "reader, writer = os.pipe()\n"
        "os.write(writer, bytes([signal.SIGINT]) + interruption._SAID)\n"
        "watcher = os.fork()\n"
        "if watcher == 0:\n"
        "    interruption._watch(reader, watched=-1, grace=0.1, numbers=[signal.SIGINT])\n"
        "    os._exit(0)\n"
        "os.waitpid(watcher, 0)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_other_signals_do_not_end_a_command(start):
    command = start("import signal; signal.signal(signal.SIGUSR1, print); time.sleep(0.1); signal.raise_signal(10)")
    command.wait(30)
    assert command.returncode == 0


def test_forked_child_does_not_keep_the_watching_process_waiting(start):
    command = start("os.fork() or (os.close(1), os.close(2), time.sleep(5), os._exit(0))")
    began = time.monotonic()
    command.wait(30)
    assert time.monotonic() - began < 5.0  # the child's end
    assert command.returncode == 0


def test_ignored_interrupt_stays_ignored(start):
    """As under `nohup`, and in the background of a script."""
    command = start("time.sleep(0.5)", "sh", "-c", 'trap \'\' INT; exec "$0" "$@"')
    os.killpg(command.pid, signal.SIGINT)
    assert command.wait(30) == 0


def test_command_that_ignores_interrupts_ends_by_sigterm_with_one_line(start):
    command = start(NATIVE, "sh", "-c", 'trap \'\' INT; exec "$0" "$@"')
    os.killpg(command.pid, signal.SIGINT)
    assert GRACE <= interrupt(command, number=signal.SIGTERM) < 5.0
    assert command.returncode == -signal.SIGTERM
    assert errors(command) == "tiscene: interrupted\n"


def test_sigterm_kills_a_worker_of_another_command_which_starts_it_again(start, monkeypatch):
    monkeypatch.setenv(interruption.PARENT, str(os.getpid()))
    command = start("time.sleep(60)")
    assert interrupt(command, group=False, number=signal.SIGTERM) < GRACE
    assert command.returncode == -signal.SIGTERM

# SPDX-License-Identifier: Apache-2.0
"""Progress of commands where stderr is no terminal."""

from tiscene.cli import terminal


def test_progress_is_lines_where_stderr_is_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "LINE_EVERY", 0.0)
    with terminal.progress("reading", 10) as step:
        step()
        step(3, task="phase a")
    with terminal.progress("merging", 0) as step:
        step()
    printed = capsys.readouterr()
    assert printed.err.splitlines() == ["reading: 1 of 10", "phase a: 4 of 10", "merging: 1"]
    assert printed.out == ""


def test_short_commands_print_no_progress_where_stderr_is_no_terminal(capsys):
    with terminal.progress("reading", 10) as step:
        step(10)
    assert capsys.readouterr().err == ""

# SPDX-License-Identifier: Apache-2.0
"""The programs of hard use: their table, and every row in a short form."""

import importlib
import sys

import pytest

from tests.stress.__main__ import ROWS, main
from tests.stress.outcomes import Outcome, count, table_line

SHORT = {"files": 0.05, "server": 0.1, "interrupts": 0.05}  # scale of rows; others 0.002


def test_table_line_keeps_to_one_line_and_four_cells():
    line = table_line("memory", Outcome("a | b", "1 MB\n  2 MB", False))
    assert line == "| memory | a \\| b | 1 MB 2 MB | **no** |"


def test_count_is_scaled_and_at_least_the_least():
    assert [count(100, 0.5), count(100, 0.001), count(100, 0.001, 4)] == [50, 1, 4]


def test_unknown_row_is_refused(capsys):
    assert main(["memroy"]) == 2
    assert "no row 'memroy'; known: memory, kills" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("memory:scene", "row 'memory' has no use 'scene' that runs alone; known: labels, fast, edits, phases, scenes"),
        ("big:lights", "row 'big' has no use 'lights' that runs alone; known: none"),
    ],
)
def test_unknown_use_is_refused(name, message, capsys):
    assert main([name]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("row", ROWS)
def test_row_holds_in_a_short_form(row):
    failed = [
        each
        for each in importlib.import_module(f"tests.stress.{ROWS[row]}").rows(SHORT.get(row, 0.002))
        if not each.held
    ]
    assert not failed, "\n".join(table_line(row, each) for each in failed)

"""The benchmarks can be found and told apart; what they measure is nobody's assertion."""

import sys
from pathlib import Path

import pytest

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks.power_law import time_for

PAGE = Path(__file__).parent.parent / "docs" / "performance.md"


def test_every_benchmark_is_found_and_says_what_it_is():
    found = benchmarks.found()
    assert {"rays", "labels", "stream"} <= set(found)
    assert "room" not in found, "the scene they share is not a benchmark"
    for main in found.values():
        assert sys.modules[main.__module__].__doc__


def test_every_benchmark_has_its_place_on_the_page():
    page = PAGE.read_text()
    assert [name for name in benchmarks.found() if f"(`{name}`)" not in page] == []


def test_times_to_equal_error_follow_the_power_law():
    measured = [(0.04, 1.0), (0.01, 4.0), (0.0025, 16.0)]  # error times time is constant
    assert time_for(0.02, measured) == pytest.approx(2.0)
    assert time_for(0.00125, measured) == pytest.approx(32.0)
    assert time_for(0.08, measured) == pytest.approx(0.5)


def test_an_unknown_one_is_refused(capsys):
    assert benchmarks.main(["ray"]) == 2
    assert "no benchmark 'ray'; there are: " in capsys.readouterr().err


def test_those_asked_for_run(monkeypatch, capsys):
    from tests.benchmarks import stream

    monkeypatch.setattr(benchmarks, "found", lambda: {"stream": stream.main})
    monkeypatch.setattr(stream.bench, "print_table", lambda source, seconds: print("table of", source.scene))
    monkeypatch.setattr(stream, "five_views", lambda scenes, settings: print("views of", *scenes, *settings))
    assert benchmarks.main([]) == 0
    printed = capsys.readouterr().out
    assert "logical cores" in printed
    assert "stream: Whole frames of a stream" in printed
    assert "table of room_02" in printed
    assert "views of room_02 object_view fast preview" in printed

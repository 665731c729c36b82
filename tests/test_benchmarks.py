# SPDX-License-Identifier: Apache-2.0
"""The benchmarks can be found and told apart; what they measure is nobody's assertion."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks import incremental, living_room, path, rays, stills
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


@pytest.fixture
def rendered(monkeypatch):
    """Renderers whose pictures are noise about one picture; what they were asked for."""
    picture = np.random.default_rng(0).uniform(0.2, 1.0, (24, 32, 3)).astype(np.float32)
    asked = []

    def renderer(noise):
        def make(room, width, height, depth, **_):
            asked.append((width, height))

            def render(spp, seed):
                random = np.random.default_rng([seed, spp])
                image = picture * (1.0 + noise / spp**0.5 * random.normal(size=picture.shape))
                return image.astype(np.float32), picture, np.full_like(picture, 0.5)

            return render

        return make

    monkeypatch.setattr(living_room, "room", lambda frame, matte: living_room.Room(None, None, None))
    monkeypatch.setattr(living_room, "tiscene", renderer(0.5))
    monkeypatch.setattr(living_room, "mitsuba", renderer(1.0))
    return asked


def numbers(line):
    return [float(each) for each in re.findall(r"\d+\.\d+", line)]


def test_half_the_noise_is_a_quarter_of_the_samples(rendered, capsys):
    stills.main()
    out, err = capsys.readouterr()
    lines = [line for line in out.splitlines() if line.split()[:1] in (["tiscene"], ["Mitsuba"])]
    assert len(lines) == 12
    for table in (lines[:6], lines[6:]):
        theirs, ours = table[:3], table[3:]
        for mine, other in zip(ours, theirs, strict=True):
            assert numbers(mine)[0] == pytest.approx(0.25 * numbers(other)[0], rel=0.1, abs=2e-4)
    assert "means of the pictures: Mitsuba" in out
    assert "matte 256x192: reference ..." in err
    assert "..." not in out
    assert set(rendered) == {(256, 192)}
    stills.main(large=True)
    assert set(rendered) == {(256, 192), (640, 480)}


def test_differences_are_compared_with_both(rendered, monkeypatch, capsys):
    def two(room, plan, truth, seed):
        assert truth.noise == pytest.approx(0.25 / (2 * plan.half), rel=0.5)
        yield incremental.Difference("difference, 4 paths", 1e-6 * seed, 0.01, 2e-6 * seed, 0.005, 3.0 * seed, 30.0)

    monkeypatch.setattr(incremental, "differences", two)
    incremental.main()
    lines = capsys.readouterr().out.splitlines()
    (line, _) = [line for line in lines if "difference, 4 paths" in line]
    assert numbers(line)[0] == 6.0  # s, the mean of three seeds
    assert line.count("(") == 2
    assert [line.split()[1] for line in lines if "LLVM" in line] == ["LLVM,"] * 6


def test_a_peer_that_is_not_installed_is_left_out(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    assert living_room.mitsuba(None, 32, 24, 5, glossy=True) is None
    assert path.mitsuba("scalar_rgb", 32, 24) is None
    assert capsys.readouterr().err.count("Mitsuba's lines are left out") == 2
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    monkeypatch.setattr(benchmarks, "found", lambda: {"rays": lambda: rays.Embree(None), "next": lambda: print("ran")})
    assert benchmarks.main([]) == 0
    out, err = capsys.readouterr()
    assert "rays is left out: import of embreex" in err
    assert "ran" in out


def test_tables_without_mitsuba(rendered, monkeypatch, capsys):
    monkeypatch.setattr(living_room, "mitsuba", lambda *_, **__: None)
    stills.main()
    assert "Mitsuba " not in capsys.readouterr().out


def test_an_interrupt_is_no_traceback(monkeypatch, capsys):
    def interrupted(large: bool = False) -> None:
        assert large
        raise KeyboardInterrupt

    monkeypatch.setattr(benchmarks, "found", lambda: {"rays": interrupted})
    assert benchmarks.main(["--large"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_those_asked_for_run(monkeypatch, capsys):
    from tests.benchmarks import stream

    monkeypatch.setattr(benchmarks, "found", lambda: {"stream": stream.main})
    monkeypatch.setattr(stream.bench, "print_table", lambda source, seconds: print("table of", source.scene))
    monkeypatch.setattr(stream, "five_views", lambda scenes, settings: print("views of", *scenes, *settings))
    monkeypatch.setattr(stream, "against_path_tracing", lambda: print("path tracing"))
    assert benchmarks.main([]) == 0
    printed = capsys.readouterr().out
    assert "logical cores" in printed
    assert "stream: Whole frames of a stream" in printed
    assert "table of room_02" in printed
    assert "views of room_02 object_view fast preview" in printed

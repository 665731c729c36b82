# SPDX-License-Identifier: Apache-2.0
"""Benchmarks are found by name and print complete tables. Their measurements are not asserted."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trimesh.transformations import euler_matrix

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks import crowd, incremental, path, rays, room, shipped_rooms, stills
from tests.benchmarks.power_law import time_for
from tests.render.path_scenes import ball, described, matte, quad
from tiscene import catalog
from tiscene.scene.camera import Camera
from tiscene.scene.description import RectLight
from tiscene.scene.material_table import MaterialTable
from tiscene.usd.read.stage_reader import read_stage

PAGE = Path(__file__).parent.parent / "docs" / "performance.md"


def test_discovery_finds_benchmarks_with_a_docstring():
    found = benchmarks.discover()
    assert {"rays", "labels", "stream"} <= set(found)
    assert "room" not in found, "the shared scene is not a benchmark"
    for main in found.values():
        assert sys.modules[main.__module__].__doc__


def test_every_benchmark_is_on_the_page():
    page = PAGE.read_text()
    assert [name for name in benchmarks.discover() if f"(`{name}`)" not in page] == []


def test_time_to_equal_error_follows_power_law():
    measured = [(0.04, 1.0), (0.01, 4.0), (0.0025, 16.0)]  # error times time is constant
    assert time_for(0.02, measured) == pytest.approx(2.0)
    assert time_for(0.00125, measured) == pytest.approx(32.0)
    assert time_for(0.08, measured) == pytest.approx(0.5)


def test_unknown_name_is_refused(capsys):
    assert benchmarks.main(["ray"]) == 2
    assert "no benchmark 'ray'; known: " in capsys.readouterr().err


@pytest.fixture
def rendered(monkeypatch):
    """Replace the renderers by noise about one picture; return the list of requested sizes."""
    picture = np.random.default_rng(0).uniform(0.2, 1.0, (24, 32, 3)).astype(np.float32)
    sizes = []

    def renderer(noise):
        def make(room, width, height, depth, **_):
            sizes.append((width, height))

            def render(spp, seed):
                random = np.random.default_rng([seed, spp])
                image = picture * (1.0 + noise / spp**0.5 * random.normal(size=picture.shape))
                return image.astype(np.float32), picture, np.full_like(picture, 0.5)

            return render

        return make

    for name in ("still_room", "living_room"):
        monkeypatch.setattr(shipped_rooms, name, lambda which, matte: shipped_rooms.Room(None, None, None))
    monkeypatch.setattr(shipped_rooms, "tiscene", renderer(0.5))
    monkeypatch.setattr(shipped_rooms, "mitsuba", renderer(1.0))
    return sizes


def numbers(line):
    return [float(each) for each in re.findall(r"\d+\.\d+", line)]


def test_stills_report_quarter_of_the_time_at_half_the_noise(rendered, capsys):
    stills.main()
    out, err = capsys.readouterr()
    lines = [line for line in out.splitlines() if line.split()[:1] in (["tiscene"], ["Mitsuba"])]
    assert len(lines) == 36
    for first in range(0, 36, 6):
        theirs, ours = lines[first : first + 3], lines[first + 3 : first + 6]
        for mine, other in zip(ours, theirs, strict=True):
            assert numbers(mine)[0] == pytest.approx(0.25 * numbers(other)[0], rel=0.1, abs=2e-4)
    assert "means of the pictures: Mitsuba" in out
    titles = [line.split()[:2] for line in out.splitlines() if "references of" in line]
    rooms = ["room_01", "room_02", "room_03"]
    assert titles == [[room, kind] for kind in ("glossy", "matte") for room in rooms]
    assert "room_01 matte 256x192: reference ..." in err
    assert "..." not in out
    assert set(rendered) == {(256, 192)}
    stills.main(large=True)
    assert set(rendered) == {(256, 192), (640, 480)}


def test_stills_of_the_scenes_that_are_asked_for(rendered, capsys):
    assert benchmarks.main(["stills", "--scene", "room_01", "--scene", "room_03"]) == 0
    titles = [line.split()[:2] for line in capsys.readouterr().out.splitlines() if "references of" in line]
    assert titles == [[room, kind] for kind in ("glossy", "matte") for room in ("room_01", "room_03")]


def switches(description):
    """Return what selects the variants of the path tracer's kernels in a scene."""
    table = MaterialTable()
    table.append(description.materials, 0)
    return table.any_coverage, table.any_emission, table.any_extended


def test_benchmark_room_takes_the_code_paths_of_a_shipped_scene():
    assert switches(room.room()) == switches(read_stage(catalog.find_scene("room_03")))


def test_incremental_rendering_is_compared_with_both_renderers(rendered, monkeypatch, capsys):
    def one_result(room, plan, truth, seed):
        assert truth.noise == pytest.approx(0.25 / (2 * plan.half), rel=0.5)
        yield incremental.IncrementalResult(
            "incremental, 4 paths", 1e-6 * seed, 0.01, 2e-6 * seed, 0.005, 3.0 * seed, 30.0
        )

    monkeypatch.setattr(incremental, "incremental_results", one_result)
    incremental.main()
    lines = capsys.readouterr().out.splitlines()
    (line, _) = [line for line in lines if "incremental, 4 paths" in line]
    assert numbers(line)[0] == 6.0  # s, the mean of three seeds
    assert line.count("(") == 2
    assert [line.split()[1] for line in lines if "LLVM" in line] == ["LLVM,"] * 6


def test_missing_peer_is_omitted(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    assert shipped_rooms.mitsuba(None, 32, 24, 5, glossy=True) is None
    assert capsys.readouterr().err.count("Mitsuba's lines are omitted") == 1
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    monkeypatch.setattr(
        benchmarks, "discover", lambda: {"rays": lambda: rays.Embree(None), "next": lambda: print("ran")}
    )
    assert benchmarks.main([]) == 0
    out, err = capsys.readouterr()
    assert "rays is omitted: import of embreex" in err
    assert "ran" in out


def test_stills_print_without_mitsuba(rendered, monkeypatch, capsys):
    monkeypatch.setattr(shipped_rooms, "mitsuba", lambda *_, **__: None)
    stills.main()
    assert "Mitsuba " not in capsys.readouterr().out


def test_path_compares_both_renderers_in_the_shipped_rooms(rendered, capsys):
    path.main()
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("room_")]
    sizes = ("256x192", "640x480")
    rooms = [(room, size) for room in ("room_01", "room_02", "room_03") for size in sizes]
    assert [tuple(line[:3]) for line in lines] == [(*room, name) for room in rooms for name in ("tiscene", "Mitsuba")]
    assert [line[-1] for line in lines[::2]] == ["1.00"] * 6
    assert all(float(line[-1]) > 0.0 for line in lines)


def test_crowd_measures_all_kinds_of_rays(monkeypatch):
    for name, value in {"WIDTH": 16, "HEIGHT": 12, "ROUNDS": 1}.items():
        monkeypatch.setattr(crowd, name, value)
    floor = quad((-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9))
    block = ball((0.0, 0.5, 0.0), 0.5, subdivisions=2)
    lamp = RectLight("Lamp", "/Lamp", euler_matrix(-0.5 * np.pi, 0.0, 0.0), (9.0, 9.0, 9.0), 1.0, 1.0)
    lamp.world_from_light[1, 3] = 3.0
    scene = replace(
        described([floor, block], [matte("white", (0.8, 0.8, 0.8))], [lamp]),
        cameras=(Camera.look_at((0, 2, 4), (0, 0, 0)),),
    )
    rates = crowd.measure(scene)
    assert rates["triangles"] == len(floor.triangles) + len(block.triangles)
    assert all(rates[kind] > 0 for kind in crowd.KINDS)


def test_interrupt_returns_130_without_traceback(monkeypatch, capsys):
    def interrupted(large: bool = False) -> None:
        assert large
        raise KeyboardInterrupt

    monkeypatch.setattr(benchmarks, "discover", lambda: {"rays": interrupted})
    assert benchmarks.main(["--large"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_stream_benchmark_prints_all_tables(monkeypatch, capsys):
    from tests.benchmarks import stream

    monkeypatch.setattr(benchmarks, "discover", lambda: {"stream": stream.main})
    monkeypatch.setattr(stream.bench, "print_table", lambda source, seconds: print("table of", source.scene))
    scenes = "object_view", "solid_benchmark"
    for name, value in (("SCENES", scenes), ("SIZE", (32, 24)), ("WARM_UP", 1), ("FRAMES", 2)):
        monkeypatch.setattr(stream, name, value)
    monkeypatch.delitem(stream.SETTINGS, "standard, 4 spp")
    monkeypatch.setattr(stream, "against_path_tracing", lambda: print("path tracing"))
    assert benchmarks.main([]) == 0
    printed = capsys.readouterr().out
    assert "logical cores" in printed
    assert "stream: Whole frames of a stream" in printed
    assert "table of room_02" in printed
    rows = re.findall(r"(\w+) +(\w+) +[0-9.]+ ms +[0-9.]+ ms +[0-9.]+", printed)
    assert rows == [(scene, quality) for scene in scenes for quality in ("fast", "preview")]

# SPDX-License-Identifier: Apache-2.0
"""`python -m tiscene.sailenv` runs scripts that were written for SAILenv."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest

from tiscene.sailenv import module_aliases, scenario_classes
from tiscene.sailenv.__main__ import main
from tiscene.sailenv.utilities import draw_flow_map

SCRIPT = """
import sys
import numpy as np
from sailenv import Vector3
from sailenv.agent import Agent
from sailenv.dynamics.uniform_movement_random_bounce import UniformMovementRandomBounce
from sailenv.dynamics.waypoints import Waypoint, CatmullWaypoints, LinearWaypoints
from sailenv.dynamics import Dynamic
from sailenv.generators.object import Object
from sailenv.generators.scenario import Scenario, Frustum
from sailenv.generators.timings import AllTogetherTimings, WaitUntilCompleteTimings, DictTimings
from sailenv.manager import SAILenvManager
from sailenv.utilities import draw_flow_map

manager = SAILenvManager(port="8085")
manager.start()
agent = Agent(depth_frame_active=True, flow_frame_active=True, object_frame_active=True, main_frame_active=True,
              category_frame_active=True, width=32, height=24, host="127.0.0.1", port=8085, use_gzip=False)
agent.register()
print("id", agent.id, sys.argv)
agent.change_scene(agent.scenes[agent.scenes.index("object_view/scene")])
here = agent.get_position()
waypoints = [Waypoint(here + offset, Vector3(0., 0., 0.)) for offset in (Vector3(0., 0., 2.), Vector3(0., 1., 3.))]
objects = [Object("c", "Cylinder", Vector3(0, 0, 2), Vector3(0, 0, 0), CatmullWaypoints(waypoints=waypoints))]
agent.load_scenario(Scenario("object_view/scene", objects, AllTogetherTimings(0.75), Frustum(False, 20.)))
try:
    frames = 0
    while True:
        frame = agent.get_frame()
        frames += 1
        assert draw_flow_map(frame["flow"]).shape == (24, 32, 3)
        if input("a key") == "q":
            break
finally:
    print("frames", frames)
    agent.delete()
"""


@pytest.fixture
def run(tmp_path, capsys):
    """Return a function that runs a script in this process and returns what it prints."""

    def run(script, *options, arguments=()):
        path = tmp_path / "script.py"
        path.write_text(script)
        main(["--spp", "1", *options, str(path), *arguments])
        return capsys.readouterr().out

    return run


def test_script_runs_unchanged_until_the_frame_limit(run):
    lines = run(SCRIPT, "--no-incremental", "--headless", "--frames", "3", arguments=("an", "--argument")).splitlines()
    assert lines[0].startswith("id 0 [")
    assert "'an', '--argument'" in lines[0]
    assert lines[-2:] == ["frames 3", "script.py: stopped after 3 frames"]


@pytest.mark.parametrize(
    ("arguments", "incremental"), [((), True), (("--no-incremental",), False), (("--quality", "photo"), False)]
)
def test_incremental_flag_of_scripts(run, arguments, incremental):
    script = (
        "from sailenv.agent import Agent\nagent = Agent(width=8, height=8)\nagent.register()\n"
        "agent.change_scene('object_view/scene')\nprint(agent.environment.stream.render_settings.incremental)\n"
        "agent.delete()\n"
    )
    assert run(script, *arguments).splitlines() == [str(incremental)]


def test_headless_disables_windows_and_key_presses(tmp_path):
    """A fake module `cv2` takes the place of OpenCV."""
    (tmp_path / "cv2.py").write_text("def imshow(*_):\n    raise SystemExit('no display')\nwaitKey = imshow\n")
    script = "import cv2\ncv2.imshow('a', None)\nprint(cv2.waitKey(1), cv2.destroyAllWindows())\n"
    path = tmp_path / "script.py"
    path.write_text(script)
    done = subprocess.run(
        [sys.executable, "-m", "tiscene.sailenv", "--headless", str(path)],
        capture_output=True,
        text=True,
        env=dict(os.environ) | {"PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])},
    )
    assert (done.stdout, done.returncode) == ("-1 None\n", 0), done.stderr


@pytest.mark.parametrize(
    ("script", "error", "message"),
    [
        ("from sailenv.agent import Agnet\n", ImportError, "cannot import name 'Agnet'"),
        ("import sailenv.nothing\n", ImportError, "No module named 'sailenv.nothing'"),
        ("raise SystemExit('status text')\n", SystemExit, "status text"),
    ],
)
def test_errors_of_a_script_are_passed_on(run, script, error, message):
    with pytest.raises(error, match=message):
        run(script)
    assert "sailenv" not in sys.modules


def test_missing_script_is_a_usage_error(capsys):
    with pytest.raises(SystemExit) as exit:
        main(["nowhere.py"])
    assert exit.value.code == 2
    assert "no file 'nowhere.py'" in capsys.readouterr().err


def test_install_makes_every_module_of_sailenv_importable(monkeypatch):
    for name in module_aliases.CONTENTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    module_aliases.install()
    try:
        for name, (source, contents) in module_aliases.CONTENTS.items():
            module = importlib.import_module(name)
            for content in contents:
                assert getattr(module, content) is getattr(source, content)
        assert sys.modules["sailenv"].generators.scenario.Scenario is scenario_classes.Scenario
    finally:
        for name in module_aliases.CONTENTS:
            sys.modules.pop(name, None)


def test_draw_flow_map_has_hue_by_direction_and_value_by_length():
    flow = np.array([[[2.0, 0.0], [-2.0, 0.0], [0.0, 0.0], [0.0, 1.0]]])
    image = draw_flow_map(flow)
    np.testing.assert_array_equal(image[0, :3], [(0, 0, 255), (255, 255, 0), (0, 0, 0)])  # BGR: red, cyan, black
    np.testing.assert_allclose(image[0, 3], (0, 127.5, 63.75), atol=0.6)  # a quarter turn: between yellow and green
    assert not draw_flow_map(np.zeros((2, 2, 2), np.float32)).any()


def test_names_of_scripts_that_speak_the_protocol_or_look_for_the_program(capsys):
    import tiscene.sailenv as sailenv

    assert [sailenv.CommandsBytes.FRAME, sailenv.CommandsBytes.GET_LIGHTS_NAMES] == [b"\x00", b"\x19"]
    assert sailenv.CommandsBytes.SET_MAIN_CAMERA_CLEAR_FLAGS + b"" == b"\x0d"
    assert sailenv.FrameFlags.NONE == 0
    assert sailenv.FrameFlags.NONE | sailenv.FrameFlags.MAIN | sailenv.FrameFlags.DEPTH == 33
    assert sailenv.AllTogetherTimings(2.0).todict() == {"type": "all_together", "description": {"wait_time": 2.0}}
    bounce = sailenv.UniformMovementRandomBounce(sailenv.Vector3(0, 1, 0), 2.0).todict()
    assert bounce["type"] == sailenv.UniformMovementRandomBounce.get_type()
    assert bounce["description"]["start_direction"] == {"x": 0, "y": 1, "z": 0}
    assert set(sailenv.executables_per_platform) == {"Darwin", "Linux", "Windows"}
    manager = sailenv.SAILenvManager(sailenv_home="bin")
    assert os.path.dirname(manager.sailenv_exe).startswith("bin")
    assert manager.start() is True
    assert str(sailenv.SAILenvException(["a"], ["b"])).split() == ["STDOUT:", "a", "STDERR:", "b"]
    sailenv.download_executable()
    sailenv.download_source(version="1.0")
    assert capsys.readouterr().out.count("nothing to download") == 2


def test_script_imports_the_downloader_and_the_table_of_commands(run):
    script = (
        "from sailenv.agent import CommandsBytes, FrameFlags\nfrom sailenv.downloader import download_executable\n"
        "from sailenv.manager import executables_per_platform\nfrom sailenv.utilities import BaseDataclass\n"
        "print(CommandsBytes.SPAWN_OBJECT, FrameFlags.NONE)\ndownload_executable()\n"
    )
    printed = run(script)
    assert printed.startswith("b'\\t' ")
    assert "nothing to download" in printed

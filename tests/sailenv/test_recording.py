# SPDX-License-Identifier: Apache-2.0
"""`tiscene sailenv record` and `tiscene render --sailenv`, read back as the laboratory's programs read recordings."""

import gzip
import json
from glob import glob
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tiscene.cli.main import main
from tiscene.export.focus_of_attention import focus_file, focus_path
from tiscene.export.sailenv_layout import Recording
from tiscene.sailenv.recorded_classes import RecordedClasses

SCRIPT = """
from sailenv import Vector3
from sailenv.agent import Agent
from sailenv.dynamics.waypoints import LinearWaypoints, Waypoint
from sailenv.generators.object import Object
from sailenv.generators.scenario import Scenario
from sailenv.generators.timings import AllTogetherTimings

agent = Agent(width=32, height=24, flow_frame_active=False, object_frame_active=False)
agent.register()
path = LinearWaypoints([Waypoint(Vector3(-1, 0, 1)), Waypoint(Vector3(1, 0.5, 1))], 1.0)
cube = Object("cube", "Cube", Vector3(0, 0, 0), Vector3(0, 0, 0), path)
agent.load_scenario(Scenario("object_view/scene", [cube], AllTogetherTimings(0.0)))
agent.change_main_camera_clear_flags(10, 20, 200)
for k in range(6):
    frame = agent.get_frame()
    assert frame["flow"] is None and frame["main"].shape == (24, 32, 3), frame
    if k == 1:
        agent.spawn_object("Sphere", (0.6, 0.8, 0))
    if k == 3:
        agent.set_rotation((0, 5, 0))
agent.delete()
"""
SCENARIO = {
    "scene_name": "object_view/scene",
    "objects": [{"id": "a", "prefab": "Cube", "position": {"x": 0, "y": 0, "z": 0}, "rotation": [0, 30, 0]}],
    "timings": {"type": "all_together", "description": {"wait_time": 0.0}},
    "frustum": False,
}
RECORD = ("sailenv", "record")
FAST = ("--spp", "1")


def read_as_laboratory(folder):
    """Read a recording by the description of its layout: frames, flow, dense classes, names, fps and focus."""
    folders = sorted(glob(f"{folder}/frames/*/"))
    assert [Path(each).name for each in folders] == [f"{n + 1:08d}" for n in range(len(folders))]
    fps = json.loads(Path(folder, "frames/fps.json").read_text())
    names = json.loads(Path(folder, "sup/map.json").read_text())
    assert sorted(names.values()) == list(range(len(names)))
    assert names["background"] == len(names) - 1
    frames = []
    for number in range(fps["frames_count"]):
        place = f"{number // 100 + 1:08d}/{number % 100 + 1:03d}"
        with Image.open(f"{folder}/frames/{place}.png") as image:
            rgb = np.asarray(image)
        arrays = {}
        for name in ("motion/{}.bin", "sup/{}.targets.bin", "sup/{}.indices.bin"):
            with gzip.GzipFile(f"{folder}/{name.format(place)}") as file:
                arrays[name] = np.load(file)
        flow, targets, indices = arrays.values()
        dense = np.full(rgb.shape[:2], 255).ravel()
        dense[indices] = targets
        assert flow.shape == (*rgb.shape[:2], 2)
        assert dense.max() < len(names)
        frames.append((rgb, flow, dense.reshape(rgb.shape[:2])))
    focus = np.loadtxt(f"{folder}/focus.foa", delimiter=",", ndmin=2)
    assert focus.shape == (len(frames), 5)
    return frames, names, fps["fps"], focus


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "script.py").write_text(SCRIPT)
    arguments = [str(folder / "script.py"), "-o", str(folder / "out"), "--classes", "sphere,cube", *FAST]
    assert main([*RECORD, *arguments]) == 0
    return folder


def test_recording_of_a_script_is_read_whole_by_a_reader_of_the_layout(recorded):
    frames, names, fps, focus = read_as_laboratory(recorded / "out")
    assert (len(frames), fps) == (6, 25.0)
    assert names == {"sphere": 0, "cube": 1, "background": 2}
    present = [sorted(set(classes.ravel().tolist())) for _, _, classes in frames]
    assert present == [[1, 2]] * 2 + [[0, 1, 2]] * 4
    for rgb, flow, classes in frames:
        assert (rgb[classes == 2] == (10, 20, 200)).mean() > 0.8  # the clear flags of the script
        assert not flow[classes == 2].any() or flow[classes == 2].all(axis=0).any()
    assert np.abs(frames[2][1][frames[2][2] == 1]).max() > 0.1
    assert (focus[:, :2] >= 0).all()
    assert (focus[:, :2] <= (23, 31)).all()
    assert set(focus[:, 4]) <= {0.0, 1.0}
    assert [classes.tobytes() for _, _, classes in frames] == [
        Recording(recorded / "out")[k].category.astype(int).tobytes() for k in range(6)
    ]


@pytest.mark.parametrize("given", [(), ("3",), ("3", "--frames", "--", "-o")])
def test_script_gets_the_arguments_after_two_hyphens(tmp_path, given):
    script = tmp_path / "script.py"
    script.write_text(f"import sys\nassert sys.argv == [__file__, *{given}], sys.argv\n{SCRIPT}")
    arguments = [str(script), "-o", str(tmp_path / "out"), "--frames", "1", "--no-focus", *FAST]
    assert main([*RECORD, *arguments, *(["--", *given] if given else [])]) == 0


def test_same_script_gives_the_same_recording(recorded):
    arguments = [str(recorded / "script.py"), "-o", str(recorded / "again"), "--classes", "sphere,cube", *FAST]
    assert main([*RECORD, *arguments]) == 0
    for path in (recorded / "out").rglob("*.*"):
        assert path.read_bytes() == (recorded / "again" / path.relative_to(recorded / "out")).read_bytes()


def test_render_of_a_script_has_the_labels_of_its_recording(recorded, capsys):
    buffers = ["--buffers", "rgb,semantic,backward_flow", "--format", "npz", "--spp", "1"]
    out = recorded / "rendered"
    assert (
        main(["render", "--sailenv", str(recorded / "script.py"), "-o", str(out), "--frames", "1:20:2", *buffers]) == 0
    )
    assert "clear flags" in capsys.readouterr().err
    frames, *_ = read_as_laboratory(recorded / "out")
    files = sorted(out.glob("*.npz"))
    assert [int(each.stem) for each in files] == [1, 3, 5]
    for path in files:
        rendered, (_, flow, classes) = np.load(path), frames[int(path.stem)]
        np.testing.assert_array_equal(rendered["semantic"] == 0, classes == 2)
        np.testing.assert_allclose(rendered["backward_flow"] * (1, -1), flow, atol=1e-3)


def test_recording_of_a_scenario_in_json(tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(SCENARIO))
    size = ["--width", "24", "--height", "16"]
    arguments = [str(tmp_path / "s.json"), "-o", str(tmp_path / "out"), "--frames", "2", *size, *FAST]
    assert main([*RECORD, *arguments]) == 0
    frames, names, *_ = read_as_laboratory(tmp_path / "out")
    assert len(frames) == 2
    assert names.keys() == {*RecordedClasses.chosen(None).names, "background"}
    assert set(frames[0][2].ravel().tolist()) == {names["cube"], names["background"]}
    arguments = ["render", "--sailenv", str(tmp_path / "s.json"), "-o", str(tmp_path / "png"), *size, "--spp", "1"]
    assert main([*arguments, "--frames", "0"]) == 0
    with Image.open(tmp_path / "png/rgb/000000.png") as image:
        assert image.size == (24, 16)


@pytest.mark.parametrize(
    ("name", "content", "arguments", "message"),
    [
        ("s.json", "{", ["--frames", "1"], "cannot be read as JSON"),
        ("s.json", "[]", ["--frames", "1"], "not a scenario of SAILenv"),
        ("s.json", json.dumps(SCENARIO), [], "give the number of frames"),
        ("s.json", json.dumps(SCENARIO | {"objects": [{"prefab": "Nothing"}]}), ["--frames", "1"], "Nothing"),
        ("s.py", "print('no agent')", [], "nothing was recorded"),
        ("s.py", "", ["--classes", "chiar"], "chiar"),
        ("s.py", "", ["--classes", "chair,background"], "background"),
        ("s.py", "", ["--frames", "0"], "--frames 0"),
        ("missing.py", None, [], "no file"),
        ("missing.json", None, [], "no file"),
    ],
)
def test_errors_of_recordings_say_what_is_wrong(tmp_path, capsys, name, content, arguments, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    assert main([*RECORD, str(tmp_path / name), "-o", str(tmp_path / "out"), *arguments, *FAST]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out/frames/fps.json").exists()


def test_earlier_recording_is_deleted_only_on_request(recorded, capsys):
    arguments = [str(recorded / "script.py"), "-o", str(recorded / "short"), "--no-focus", *FAST, "--frames"]
    assert main([*RECORD, *arguments, "3"]) == 0
    assert main([*RECORD, *arguments, "1"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*RECORD, str(recorded / "missing.py"), *arguments[1:], "1", "--overwrite"]) == 2
    assert len(Recording(recorded / "short")) == 3
    assert main([*RECORD, *arguments, "1", "--overwrite"]) == 0
    assert len(list((recorded / "short").rglob("*.png"))) == len(Recording(recorded / "short")) == 1
    assert not (recorded / "short/focus.foa").exists()


def test_focus_goes_to_details_and_stays_with_what_moves():
    rgb, flow = np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64, 2), np.float32)
    rgb[8:12, 48:52] = 255
    *_, still = focus_path([(rgb, flow)] * 75, 25.0)
    assert np.hypot(still[0] - 10, still[1] - 50) < 4
    flow[36:40, 8:12] = 1.0
    lines = list(focus_path([(rgb, flow)] * 75, 25.0))
    assert np.hypot(lines[-1][0] - 38, lines[-1][1] - 10) < 12
    assert lines[0][4] == 0
    assert any(line[4] for line in lines)
    assert focus_file(lines) == focus_file(focus_path([(rgb, flow)] * 75, 25.0))
    *_, empty = focus_path([(rgb * 0, flow * 0)] * 3, 25.0)
    assert empty == (23.5, 31.5, 0.0, 0.0, 0)

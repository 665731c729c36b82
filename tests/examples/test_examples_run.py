# SPDX-License-Identifier: Apache-2.0
"""The scripts and the notebook in examples/ run, in short forms."""

import base64
import importlib.util
import io
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

EXAMPLES = Path(__file__).parents[2] / "examples"
TESTS = Path(__file__).parents[1]
# Arguments of the short forms.
SCRIPTS = {
    "edits.py": ("--width", "16"),
    "export_and_read.py": ("dataset", "--frames", "4", "--width", "16"),
    "loop.py": ("--frames", "2", "--width", "16"),
}


def test_every_script_is_run_by_a_test():
    tests = "".join(path.read_text("utf-8") for path in TESTS.rglob("test_*.py"))
    assert not [path.name for path in EXAMPLES.glob("*.py") if path.name not in tests]


@pytest.mark.parametrize(
    "script",
    [pytest.param(name, marks=pytest.mark.slow) if name == "loop.py" else name for name in SCRIPTS],  # README has it
)
def test_script_runs(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [script, *SCRIPTS[script]])
    runpy.run_path(str(EXAMPLES / script), run_name="__main__")
    assert capsys.readouterr().out


@pytest.mark.slow
def test_network_trains_and_draws_a_plot(tmp_path):
    for package in ("torch", "matplotlib"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"needs {package}")
    program = [sys.executable, EXAMPLES / "train_online.py", "--frames", "4", "--plot", "plot.png"]
    printed = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert "4 frames: " in printed
    with Image.open(tmp_path / "plot.png") as plot:
        assert len(np.unique(np.asarray(plot.convert("L")))) > 10


def test_room_of_the_documentation_is_the_file():
    page = (EXAMPLES.parent / "docs" / "minimal-room.md").read_text("utf-8")
    blocks = [block.split("```")[0] for block in page.split("```usda\n")[1:]]
    lines = [line for block in blocks for line in block.splitlines() if line]
    assert lines == [line for line in (EXAMPLES / "minimal_room.usda").read_text("utf-8").splitlines() if line]


def test_minimal_room_is_labeled_and_lit():
    from tiscene.stream.stream import Stream

    stream = Stream(EXAMPLES / "minimal_room.usda", width=32, height=24, buffers=("semantic", "instance"))
    frame = stream[0]
    names = {frame.categories[id] for id in np.unique(frame.semantic)}
    assert names == {"", "floor", "wall", "ball"}
    assert [type(light).__name__ for light in stream.world.stage.lights] == ["RectLight", "DomeLight"]


def test_pictures_of_the_notebook_are_stored():
    nbformat = pytest.importorskip("nbformat")
    outputs = [
        output for cell in nbformat.read(EXAMPLES / "notebook.ipynb", 4).cells for output in cell.get("outputs", ())
    ]
    assert not [output for output in outputs if output.output_type == "error"]
    pictures = [output.data["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) >= 3
    for picture in pictures:
        with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
            assert min(image.size) >= 100


@pytest.mark.slow
def test_notebook_runs(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(EXAMPLES / "notebook.ipynb", 4)
    for cell in notebook.cells:
        cell.source = cell.source.replace('"width": 256, "height": 192', '"width": 32, "height": 24')
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output.data for cell in notebook.cells for output in cell.get("outputs", ()) if "data" in output]
    assert any('alt="forward_flow"' in data.get("text/html", "") for data in shown)

# SPDX-License-Identifier: Apache-2.0
"""What the documentation says, checked against the code. `python -m tests.docs.test_docs` writes the tables of buffers."""

import ast
import importlib.util
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import tiscene.usd
from tiscene.cli import parser
from tiscene.export import EXPORTERS
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.object_table import ObjectRow
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)
TABLE = re.compile(r"(?<=<!-- buffers -->\n).*?(?=<!-- /buffers -->)", re.DOTALL)


def buffer_table() -> str:
    """The buffers as a Markdown table."""
    lines = ["| Buffer | Array | Unit | Nothing hit | Meaning |", "|---|---|---|---|---|"]
    for aov in BUFFERS.values():
        shape = ", ".join(["H", "W", *map(str, aov.channels)])
        background = {None: "computed", True: "True"}.get(aov.background)
        if background is None:
            background = "NaN" if np.isnan(aov.background) else "+∞" if np.isinf(aov.background) else "0"
        lines.append(f"| `{aov.name}` | {aov.dtype} {shape} | {aov.unit or '–'} | {background} | {aov.doc} |")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("page", ["README.md", "docs/buffers.md"])
def test_tables_of_buffers_are_up_to_date(page):
    (table,) = TABLE.findall((ROOT / page).read_text(encoding="utf-8"))
    assert table == buffer_table(), "run `python -m tests.docs.test_docs`"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_files_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    broken = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_examples_are_python(page):
    for example in BLOCK.findall(page.read_text(encoding="utf-8")):
        ast.parse(example)


# Pages whose Python runs as it stands, block after block, in a folder that holds `run.json` and `upload.usdz`; others
# have tests of their own, or need what is not here: imported.md models of other people.
RUN = ("buffers", "incremental", "learning", "scenario", "scenes", "templates", "usd", "usd_scenarios")


@pytest.mark.parametrize("page", RUN)
def test_the_python_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Scenario("object_view", [Object("ball", "Sphere", (0, 1, -3))]).save("run.json")
    Path("upload.usda").write_text('#usda 1.0\ndef Cube "Box"\n{\n}\ndef DomeLight "Sky"\n{\n}\n')
    with zipfile.ZipFile("upload.usdz", "w") as package:
        package.write("upload.usda")
    names = {
        "__name__": "__main__",
        **dict.fromkeys(("learn", "predict", "teach"), lambda *_: None),
        "tiscene": tiscene,
    }
    blocks = BLOCK.findall((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8"))
    assert blocks
    for block in blocks:
        if "import torch" not in block:
            exec(compile(block.replace("frames=250", "frames=3"), f"{page}.md", "exec"), names)
        elif all(map(importlib.util.find_spec, re.findall(r"^(?:import|from) (torch|avalanche)", block, re.MULTILINE))):
            # A file, for workers import it.
            Path("script.py").write_text(f"def learn(*_):\n    pass\n\n\n{block}", encoding="utf-8")
            subprocess.run([sys.executable, "script.py"], check=True)


def test_the_pages_that_run_are_all_there_are():
    with_python = {
        page.stem for page in (ROOT / "docs").glob("*.md") if "```python" in page.read_text(encoding="utf-8")
    }
    assert with_python - set(RUN) == {"examples", "export", "imported"}


def test_the_loop_of_the_readme_runs():
    (example,) = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    small = example.replace("width=256, height=192, frames=100", "width=32, height=24, frames=2, spp=1")
    assert small != example
    learned = []
    exec(small, {"learn": lambda *arrays: learned.append([array.shape for array in arrays])})
    assert learned == [[(24, 32, 3), (24, 32), (24, 32), (24, 32, 2)]] * 2


@pytest.mark.parametrize("number", range(3))
def test_the_examples_run(number):
    examples = BLOCK.findall((ROOT / "docs/examples.md").read_text(encoding="utf-8"))
    assert len(examples) == 3
    names = {}
    exec(examples[number], names)
    stream = Stream(names["scenario"], width=64, height=48, buffers=("instance",))
    first, later = stream[0], stream[40]
    moved = [row.name for row in later.objects if row.template and row.position != first.objects.by_id(row.id).position]
    assert moved == [each.id for each in names["scenario"].objects]
    for name in moved:
        assert first.objects.by_name(name).visible_pixels > 0
        x0, y0, x1, y1 = later.objects.by_name(name).amodal_box
        assert min(64 - x0, x1, 48 - y0, y1) > 0  # the box reaches into the picture


def test_the_scenario_of_the_documentation_can_be_read():
    (text,) = re.findall(r"```json\n(.*?)```", (ROOT / "docs/scenario.md").read_text(encoding="utf-8"), re.DOTALL)
    scenario = Scenario.from_json(json.loads(text))
    assert [item.id for item in scenario.objects] == ["chair", "pillow"]
    assert Scenario.from_json(scenario.to_json()) == scenario


SPHERE = "/SolidBenchmark/Solids/Sphere"


def test_the_page_of_exports_runs(tmp_path, monkeypatch):
    """Its commands, and what reads what they write; in a room that is read sooner."""
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs/export.md").read_text(encoding="utf-8")
    instead = {"room_02": "solid_benchmark", "/Room02/Furniture/Sofa": SPHERE, '"Chair 01"': f'"{SPHERE}"'}
    for name, other in instead.items():
        assert name in page
        page = page.replace(name, other)
    commands = re.findall(r"^    tiscene (render .*)", page, re.MULTILINE)
    assert len(commands) == len(EXPORTERS)
    for command in commands:
        short = re.sub(r"--frames \d+:\d+", "--frames 0:2", command)
        assert parser.main([*short.split(), "--width", "32", "--height", "24", "--spp", "1"]) == 0
    names = {"learn": lambda *_: None}
    for block in BLOCK.findall(page):
        exec(block.replace('_benchmark", ', '_benchmark", width=32, height=24, spp=1, '), names)
    assert names["depth"].shape == names["sofa"].shape == names["chairs"].shape == (24, 32)
    coco = json.loads(Path("out/coco.json").read_text())
    assert len(coco["images"]) == 2
    for each in coco["annotations"]:
        runs, (height, width) = each["segmentation"]["counts"], each["segmentation"]["size"]
        mask = np.repeat(np.arange(len(runs)) % 2, runs).reshape(width, height).T
        assert mask.sum() == each["area"]
        y, x = np.nonzero(mask)
        assert each["bbox"] == [x.min(), y.min(), np.ptp(x) + 1, np.ptp(y) + 1]


def test_every_column_of_a_row_is_on_the_page():
    page = (ROOT / "docs/buffers.md").read_text(encoding="utf-8")
    first_cells = re.findall(r"^\| (`.*?) \|", page[page.index("| Of a row |") :], re.MULTILINE)
    told = re.findall(r"`(\w+)`", " ".join(first_cells))
    assert sorted(told) == sorted(name for name in {*ObjectRow.__annotations__, *vars(ObjectRow)} if name[0] != "_")


def test_every_export_format_has_its_section():
    sections = re.findall(r"^## (\w+):", (ROOT / "docs/export.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {section.lower() for section in sections} >= set(EXPORTERS)


if __name__ == "__main__":
    for page in ("README.md", "docs/buffers.md"):
        path = ROOT / page
        path.write_text(TABLE.sub(lambda _: buffer_table(), path.read_text(encoding="utf-8")), encoding="utf-8")

# SPDX-License-Identifier: Apache-2.0
"""The documentation is checked against the code: links, tables, commands and Python examples.

`python -m tests.docs.test_docs` regenerates the tables of buffers in README.md and docs/buffers.md.
"""

import ast
import importlib.util
import json
import re
import subprocess
import sys
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from tiscene.cli import main as command_line
from tiscene.errors import MissingExtra
from tiscene.export.formats import FORMATS, format_table
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.object_table import ObjectRow
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.stream.stream import Stream

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)
TABLE = re.compile(r"(?<=<!-- buffers -->\n).*?(?=<!-- /buffers -->)", re.DOTALL)
FORMAT_TABLE = re.compile(r"(?<=<!-- formats -->\n).*?(?=<!-- /formats -->)", re.DOTALL)
FENCED = re.compile(r"```.*?```", re.DOTALL)
# Pages whose Python needs a set-up of its own, and the test that runs it. All other pages run as they stand.
RUN_ELSEWHERE = {
    "examples": "test_examples_render_objects_that_move",
    "export": "test_export_pages_run",
    "export-recipes": "test_export_pages_run",
    "importing": "none: it needs models that are not in the repository",
}
# Their Python takes long.
SLOW = {"evaluate", "factors", "learning", "looking", "scenes", "taichi", "training", "tutorial"}
ANY_SCENE = {"sampling", "scenario", "scenario-recipes", "usd_scenarios"}  # run in a scene that loads faster
# Blocks with these imports run as scripts: worker processes import the file, and Taichi reads the source of kernels.
NEEDS_SCRIPT = re.compile(r"^(?:import|from) (torch|avalanche|taichi|datasets|grain)", re.MULTILINE)
SPHERE = "/SolidBenchmark/Solids/Sphere"

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def read(page: Path | str) -> str:
    """Return the text of a page, given relative to the repository's root."""
    return (ROOT / page).read_text(encoding="utf-8")


def buffer_table() -> str:
    """Return the buffers as a Markdown table."""
    lines = ["| Buffer | Array | Unit | Nothing hit | Meaning |", "|---|---|---|---|---|"]
    for buffer in BUFFERS.values():
        shape = ", ".join(["H", "W", *map(str, buffer.channels)])
        background = {None: "computed", True: "True"}.get(buffer.background)
        if background is None:
            background = "NaN" if np.isnan(buffer.background) else "+∞" if np.isinf(buffer.background) else "0"
        lines.append(
            f"| `{buffer.name}` | {buffer.dtype} {shape} | {buffer.unit or '–'} | {background} | {buffer.doc} |"
        )
    return "\n".join(lines) + "\n"


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", FENCED.sub("", read(page)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", ["README.md", "docs/buffers.md"])
def test_table_of_buffers_matches_code(page):
    (table,) = TABLE.findall(read(page))
    assert table == buffer_table(), "run `python -m tests.docs.test_docs`"


def test_table_of_formats_matches_code():
    (table,) = FORMAT_TABLE.findall(read("docs/export.md"))
    assert table == format_table(), "run `python -m tests.docs.test_docs`"


@each_page
def test_links_lead_to_existing_files_and_headings(page):
    links = re.findall(r"\]\(([^)#]*)(?:#([^)]*))?\)", FENCED.sub("", read(page)))
    local = [(page.parent / file if file else page, anchor) for file, anchor in links if "://" not in file]
    broken = [
        (str(file), anchor) for file, anchor in local if not file.exists() or (anchor and anchor not in anchors(file))
    ]
    assert not broken


@each_page
def test_named_test_files_exist(page):
    named = re.findall(r"`(?:[\w/]+/)?(test_\w+\.py)", read(page))
    assert set(named) <= {path.name for path in (ROOT / "tests").rglob("test_*.py")}


def test_index_links_to_every_page():
    linked = re.findall(r"\]\(([^)#]+)\)", read("docs/index.md"))
    pages = {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")} - {"index.md"}
    assert pages <= set(linked)


@each_page
def test_python_blocks_parse(page):
    for example in BLOCK.findall(read(page)):
        ast.parse(example)


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.slow) if page in SLOW else page
        for page in sorted(page.stem for page in DOCS.glob("*.md") if BLOCK.search(read(page)))
        if page not in RUN_ELSEWHERE
    ],
)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    """Blocks run one after another in one namespace, in a folder with `run.json` and `upload.usdz`."""
    monkeypatch.chdir(tmp_path)
    Scenario("object_view", [Object("ball", "Sphere", (0, 1, -3))]).save("run.json")
    Path("upload.usda").write_text('#usda 1.0\ndef Cube "Box" {}\ndef DomeLight "Sky" {}\n')
    with zipfile.ZipFile("upload.usdz", "w") as package:
        package.write("upload.usda")
    names = {
        "__name__": "__main__",
        **dict.fromkeys(("learn", "predict", "teach"), lambda *_: None),
    }
    blocks = BLOCK.findall(read(f"docs/{page}.md"))
    assert blocks
    for block in blocks:
        block = block.replace("frames=250", "frames=3").replace("frames=10)", "frames=1)")
        if page in ANY_SCENE:
            block = block.replace('"room_02"', '"solid_benchmark"')
        needed = NEEDS_SCRIPT.findall(block)
        if not needed:
            try:
                exec(compile(block, f"{page}.md", "exec"), names)
            except MissingExtra as missing:
                pytest.skip(str(missing))
        elif all(map(importlib.util.find_spec, needed)):
            Path("script.py").write_text(f"def learn(*_):\n    pass\n\n\n{block}", encoding="utf-8")
            subprocess.run([sys.executable, "script.py"], check=True)


def test_pages_that_run_elsewhere_have_python():
    assert all(BLOCK.search(read(f"docs/{page}.md")) for page in RUN_ELSEWHERE)
    tests = {test for test in RUN_ELSEWHERE.values() if test.startswith("test_")}
    assert tests <= set(globals())


def test_loop_of_readme_runs(capsys):
    (example,) = BLOCK.findall(read("README.md"))
    small = example.replace("width=256, height=192, frames=100", "width=32, height=24, frames=2, spp=1")
    assert small != example
    assert len(example.splitlines()) == 12
    exec(small, {})
    lines = [line.split(" (24, 32, 3) ") for line in capsys.readouterr().out.splitlines()]
    assert [index for index, _ in lines] == ["0", "1"]


@pytest.mark.parametrize("number", [0, *(pytest.param(each, marks=pytest.mark.slow) for each in (1, 2))])
def test_examples_render_objects_that_move(number):
    examples = BLOCK.findall(read("docs/examples.md"))
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
        assert min(64 - x0, x1, 48 - y0, y1) > 0  # the box overlaps the picture


def test_scenario_of_documentation_round_trips():
    (text,) = re.findall(r"```json\n(.*?)```", read("docs/scenario.md"), re.DOTALL)
    scenario = Scenario.from_json(json.loads(text))
    assert [item.id for item in scenario.objects] == ["chair", "pillow"]
    assert Scenario.from_json(scenario.to_json()) == scenario


def test_export_pages_run(tmp_path, monkeypatch):
    """Run the commands of export.md, then the Python of both pages on what they wrote, in a scene that loads faster."""
    for library in ("av", "h5py", "mcap", "pyarrow", "rerun"):  # of the extra `formats`
        pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    pages = read("docs/export.md") + read("docs/export-recipes.md")
    smaller = {"room_02": "solid_benchmark", "/Room02/Furniture/Sofa": SPHERE, '"Chair 01"': f'"{SPHERE}"'}
    for name, other in smaller.items():
        assert name in pages
        pages = pages.replace(name, other)
    commands = re.findall(r"^    tiscene (render .*)", pages, re.MULTILINE)
    assert len(commands) == len(FORMATS)
    for command in commands:
        short = re.sub(r"--frames \d+:\d+", "--frames 0:2", command)
        assert command_line.main([*short.split(), "--width", "32", "--height", "24", "--spp", "1"]) == 0
    names = {"learn": lambda *_: None}
    for block in BLOCK.findall(pages):
        exec(block.replace('_benchmark", ', '_benchmark", width=32, height=24, spp=1, '), names)
    del FORMATS["listing"]  # the page's own
    assert names["depth"].shape == names["sofa"].shape == names["chairs"].shape == (24, 32)


def test_every_column_of_the_object_table_is_documented():
    page = read("docs/buffers.md")
    first_cells = re.findall(r"^\| (`.*?) \|", page[page.index("| Column |") :], re.MULTILINE)
    documented = re.findall(r"`(\w+)`", " ".join(first_cells))
    assert sorted(documented) == sorted(
        name for name in {*(each.name for each in fields(ObjectRow)), *vars(ObjectRow)} if name[0] != "_"
    )


def test_every_export_format_has_a_section():
    sections = re.findall(r"^## ([\w-]+):", read("docs/export.md"), re.MULTILINE)
    assert {section.lower() for section in sections} >= set(FORMATS)


if __name__ == "__main__":
    for page in ("README.md", "docs/buffers.md"):
        (ROOT / page).write_text(TABLE.sub(lambda _: buffer_table(), read(page)), encoding="utf-8")
    page = ROOT / "docs/export.md"
    page.write_text(FORMAT_TABLE.sub(lambda _: format_table(), page.read_text(encoding="utf-8")), encoding="utf-8")

"""What the documentation says, checked against the code. `python -m tests.test_docs` writes the tables of buffers."""

import ast
import importlib.util
import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import tiscene.usd
from tiscene.export import EXPORTERS
from tiscene.render.aovs import AOVS
from tiscene.scenario import Object, Scenario
from tiscene.stream import Stream

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
TABLE = re.compile(r"(?<=<!-- buffers -->\n).*?(?=<!-- /buffers -->)", re.DOTALL)


def buffer_table() -> str:
    """The buffers as a Markdown table."""
    lines = ["| Buffer | Array | Unit | Nothing hit | Meaning |", "|---|---|---|---|---|"]
    for aov in AOVS.values():
        shape = ", ".join(["H", "W", *map(str, aov.channels)])
        background = {None: "computed", True: "True"}.get(aov.background)
        if background is None:
            background = "NaN" if np.isnan(aov.background) else "+∞" if np.isinf(aov.background) else "0"
        lines.append(f"| `{aov.name}` | {aov.dtype} {shape} | {aov.unit or '–'} | {background} | {aov.doc} |")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("page", ["README.md", "docs/buffers.md"])
def test_tables_of_buffers_are_up_to_date(page):
    (table,) = TABLE.findall((ROOT / page).read_text(encoding="utf-8"))
    assert table == buffer_table(), "run `python -m tests.test_docs`"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_files_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    broken = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_examples_are_python(page):
    for example in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        ast.parse(example)


# Pages whose Python runs as it stands, block after block, in a folder that holds `run.json` and `upload.usdz`; others
# have tests of their own, or need what is not here: imported.md models of other people.
RUN = ("differential", "learning", "scenario", "scenes", "templates", "usd", "usd_scenarios")


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
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    for block in blocks:
        if "import torch" not in block or importlib.util.find_spec("torch"):
            exec(compile(block.replace("frames=250", "frames=3"), f"{page}.md", "exec"), names)


def test_the_pages_that_run_are_all_there_are():
    with_python = {
        page.stem for page in (ROOT / "docs").glob("*.md") if "```python" in page.read_text(encoding="utf-8")
    }
    assert with_python - set(RUN) == {"examples", "imported"}


def test_the_loop_of_the_readme_runs():
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    small = example.replace("width=256, height=192, frames=100", "width=32, height=24, frames=2, spp=1")
    assert small != example
    learned = []
    exec(small, {"learn": lambda *arrays: learned.append([array.shape for array in arrays])})
    assert learned == [[(24, 32, 3), (24, 32), (24, 32), (24, 32, 2)]] * 2


@pytest.mark.parametrize("number", range(3))
def test_the_examples_run(number):
    examples = re.findall(r"```python\n(.*?)```", (ROOT / "docs/examples.md").read_text(encoding="utf-8"), re.DOTALL)
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


def test_every_export_format_has_its_section():
    sections = re.findall(r"^## (\w+):", (ROOT / "docs/export.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {section.lower() for section in sections} >= set(EXPORTERS)


if __name__ == "__main__":
    for page in ("README.md", "docs/buffers.md"):
        path = ROOT / page
        path.write_text(TABLE.sub(lambda _: buffer_table(), path.read_text(encoding="utf-8")), encoding="utf-8")

# SPDX-License-Identifier: Apache-2.0
"""Imports between packages run one way.

Read from the source, so that an import inside a function or under `if TYPE_CHECKING` counts as well.
"""

import ast
import functools
import importlib
import sys
import tomllib
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("tiscene", "dynamics", "usd_scenes", "docs")

# Each room of the project, and the rooms that it may import; a room may always import itself.
MAY_IMPORT = {
    "dynamics": set(),
    "usd_scenes": set(),
    "usd_scenes.author": {"tiscene.usd"},
    "docs": {
        "tiscene.learning",
        "tiscene",
        "tiscene.catalog",
        "tiscene.cli",
        "tiscene.export",
        "tiscene.usd",
        "usd_scenes.author",
    },
    "tiscene": {"dynamics", "tiscene.errors"},  # the front door; its names are imported at first use
    "tiscene.errors": {"dynamics"},
    "tiscene.files": set(),
    "tiscene.catalog": {"tiscene.errors", "usd_scenes"},
    "tiscene.device": {"tiscene.errors", "tiscene.files"},
    "tiscene.scene": {"dynamics", "tiscene.device", "tiscene.errors"},
    "tiscene.scenario": {"dynamics", "tiscene.catalog", "tiscene.errors", "tiscene.files", "tiscene.scene"},
    "tiscene.frame": {"dynamics", "tiscene.errors", "tiscene.files", "tiscene.scene"},
    "tiscene.usd": {"dynamics", "tiscene.catalog", "tiscene.errors", "tiscene.files", "tiscene.scene"},
    "tiscene.render": {
        "dynamics",
        *("tiscene.device", "tiscene.errors", "tiscene.files", "tiscene.frame", "tiscene.scene"),
    },
    "tiscene.world": {
        *("dynamics", "tiscene.errors", "tiscene.files", "tiscene.frame", "tiscene.scenario", "tiscene.scene"),
    },
    "tiscene.randomization": {
        *("dynamics", "tiscene.catalog", "tiscene.device", "tiscene.errors", "tiscene.frame", "tiscene.render"),
        *("tiscene.scenario", "tiscene.scene", "tiscene.stream", "tiscene.usd", "tiscene.world"),
    },
    "tiscene.stream": {
        "dynamics",
        *("tiscene.catalog", "tiscene.device", "tiscene.errors", "tiscene.frame", "tiscene.render", "tiscene.scenario"),
        *("tiscene.scene", "tiscene.usd", "tiscene.world"),
    },
    "tiscene.sailenv": {
        *("dynamics", "tiscene.catalog", "tiscene.device", "tiscene.errors", "tiscene.frame", "tiscene.render"),
        *("tiscene.scenario", "tiscene.scene", "tiscene.stream", "tiscene.usd", "tiscene.world"),
    },
    "tiscene.export": {
        *("tiscene", "tiscene.errors", "tiscene.files", "tiscene.frame", "tiscene.scene", "tiscene.stream"),
        "tiscene.sailenv",  # the coordinates of SAILenv's layout
        "dynamics",  # the checks of arguments
        *("tiscene.catalog", "tiscene.render", "tiscene.scenario", "tiscene.usd"),  # to render an export again
    },
    "tiscene.learning": {
        *("dynamics", "tiscene", "tiscene.errors", "tiscene.files", "tiscene.frame", "tiscene.render"),
        *("tiscene.scenario", "tiscene.scene", "tiscene.stream", "tiscene.world"),
        "tiscene.randomization",
    },
    "tiscene.cli": {
        *("dynamics", "tiscene", "tiscene.catalog", "tiscene.errors", "tiscene.export", "tiscene.files"),
        "tiscene.frame",
        *("tiscene.sailenv", "tiscene.scenario", "tiscene.scene", "tiscene.stream", "tiscene.usd"),
        "tiscene.learning",
    },
    "tiscene.__main__": {"tiscene.cli"},
}

# File names that several packages share on purpose: `dynamics` stands alone.
SHARED_NAMES = {
    "errors": ["tiscene/errors.py", "dynamics/errors.py"],
    "kernel_types": ["tiscene/device/kernel_types.py", "dynamics/kernel_types.py"],
    "view": ["tiscene/cli/view.py", "tiscene/render/view.py"],  # modules of commands have the commands' names
}

# Functions that a lower room calls by name and imports at first use, so that its own users need neither USD nor Taichi.
CALLED_BY_NAME = {
    "read_usd": "tiscene.usd.scenario.read:read_scenario",
    "write_usd": "tiscene.usd.scenario.write:write_scenario",
    "sample": "tiscene.randomization.sampler:sample",
    "sample_difficulty": "tiscene.randomization.difficulty_search:sample_difficulty",
    "with_factor": "tiscene.randomization.factors:with_factor",
    "ranges": "tiscene.randomization.ranges:ScenarioRanges",
    "free_places": "tiscene.randomization.free_places:FreePlaces",
    "template": "tiscene.usd.read.template:read_template",  # by the catalog, for categories in binary templates
}

# Packages that may be imported in some places only.
ONLY_IN = {
    "pxr": ("tiscene/usd/", "usd_scenes/author/"),
    "pyoidn": ("tiscene/render/",),
    "OpenEXR": ("tiscene/usd/", "tiscene/export/"),
    "PIL": (
        "tiscene/usd/",
        "tiscene/export/",
        "tiscene/frame/frame_display.py",
        "usd_scenes/author/",
        "docs/tools/template_sheet.py",
        "docs/tools/gallery.py",
        "tiscene/learning/results_page.py",
        "tiscene/learning/adapters/unaiverse_streams.py",
    ),
    "rich": ("tiscene/cli/",),
    "trimesh": ("tiscene/usd/", "usd_scenes/author/"),
}


# Files past 400 lines, each with its reason.
LONG_FOR_A_REASON: dict[str, str] = {}


def sources(*packages: str) -> list[Path]:
    return [path for package in packages for path in sorted((ROOT / package).rglob("*.py"))]


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@pytest.fixture(scope="module", autouse=True)
def forget_syntax_trees() -> Iterator[None]:
    """A million objects would slow down the garbage collector in all later tests."""
    yield
    parsed.cache_clear()


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str:
    """The top-level package, or the child of `tiscene`, that a module lies in."""
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "tiscene" or parts[:2] == ["usd_scenes", "author"] else parts[0]


@functools.cache
def imported_modules(path: Path) -> frozenset[str]:
    """Absolute names of what a file imports; `from package import name` counts as package.name where that is a file."""
    modules = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                target = ROOT / full.replace(".", "/")
                is_module = target.with_suffix(".py").is_file() or target.is_dir()
                modules.add(full if is_module else str(node.module))
    return frozenset(modules)


@pytest.mark.parametrize("path", sources(*PACKAGES), ids=lambda path: str(path.relative_to(ROOT)))
def test_module_imports_only_allowed_rooms(path):
    room = room_of(module_name(path))
    assert room in MAY_IMPORT, f"{room} is not in MAY_IMPORT"
    others = {room_of(name) for name in imported_modules(path) if name.split(".")[0] in PACKAGES} - {room}
    assert others <= MAY_IMPORT[room], f"{path.relative_to(ROOT)} imports {sorted(others - MAY_IMPORT[room])}"


def floors() -> dict[str, int]:
    """Return the floor of each room: one above the highest room that it may import; 0 beside `tiscene`.

    Fails for a cycle.
    """
    found: dict[str, int] = {"dynamics": 0, "usd_scenes": 0}

    def floor(room: str, above: tuple[str, ...] = ()) -> int:
        assert room not in above, f"cycle: {' -> '.join([*above, room])}"
        if room not in found:
            found[room] = 1 + max((floor(below, (*above, room)) for below in MAY_IMPORT[room]), default=0)
        return found[room]

    for room in MAY_IMPORT:
        floor(room)
    return found


def test_rooms_have_no_cycle_and_at_most_ten_floors():
    found = floors()
    assert MAY_IMPORT["dynamics"] == MAY_IMPORT["usd_scenes"] == set()
    assert found["tiscene.scene"] < found["tiscene.world"] < found["tiscene.stream"] < found["tiscene.export"]
    assert max(found.values()) == found["tiscene.__main__"] <= 10


def test_tiscene_has_at_most_eighteen_rooms():
    folder = ROOT / "tiscene"
    assert len([*folder.glob("*.py"), *folder.glob("*/__init__.py")]) <= 18


def test_modules_have_no_import_cycle():
    modules = {module_name(path): path for path in sources(*PACKAGES)}
    graph = {name: imported_modules(path) & modules.keys() - {name} for name, path in modules.items()}
    TopologicalSorter(graph).prepare()  # raises CycleError


def test_upward_calls_are_those_listed():
    from tiscene.catalog import TEMPLATE_READER
    from tiscene.scenario.providers import PROVIDERS

    assert PROVIDERS | {"template": ":".join(TEMPLATE_READER)} == CALLED_BY_NAME
    for target in CALLED_BY_NAME.values():
        module, function = target.split(":")
        assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize("kind", ["class", "file"])
def test_names_are_unique(kind):
    """A class or a file has a name of its own; those of SAILenv's API repeat ours on purpose."""
    places: dict[str, list[str]] = {}
    for path in sources("tiscene", "dynamics", "usd_scenes"):
        if path.stem.startswith("__") or (kind == "class" and path.name == "scenario_classes.py"):
            continue
        names = [path.stem] if kind == "file" else []
        if kind == "class":
            names = [node.name for node in ast.walk(parsed(path)) if isinstance(node, ast.ClassDef)]
        for name in names:
            places.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == (SHARED_NAMES if kind == "file" else {})


@functools.cache
def kernel_modules() -> list[str]:
    """Modules that define Taichi kernels or functions."""
    return sorted(
        module_name(path)
        for path in sources(*PACKAGES)
        if any(
            ast.unparse(decorator) in ("ti.kernel", "ti.func")
            for node in ast.walk(parsed(path))
            if isinstance(node, ast.FunctionDef)
            for decorator in node.decorator_list
        )
    )


def test_kernel_modules_are_those_that_mypy_reads_leniently():
    overrides = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    assert not any(override.get("ignore_errors") for override in overrides)
    (lenient,) = [override["module"] for override in overrides if override.get("disallow_untyped_decorators") is False]
    assert lenient == kernel_modules()


def test_kernel_modules_keep_their_annotations():
    paths = [ROOT / (module.replace(".", "/") + ".py") for module in kernel_modules()]
    strings = [path for path in paths if "__future__" in imported_modules(path)]
    assert not strings, "Taichi cannot read annotations that are strings"


@pytest.mark.parametrize("package", ONLY_IN)
def test_packages_with_a_home_stay_there(package):
    users = [
        str(path.relative_to(ROOT))
        for path in sources(*PACKAGES)
        if package in {module.split(".")[0] for module in imported_modules(path)}
    ]
    strangers = [user for user in users if not user.startswith(ONLY_IN[package])]
    assert not strangers, f"{package} belongs to {ONLY_IN[package]}"


def test_dynamics_needs_numpy_and_taichi_only():
    outside = {
        module.split(".")[0] for path in sources("dynamics") for module in imported_modules(path)
    } - sys.stdlib_module_names
    assert outside <= {"numpy", "taichi", "dynamics"}


def test_only_the_device_module_starts_taichi():
    calls = [
        str(path.relative_to(ROOT))
        for path in sources(*PACKAGES)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("ti.init", "taichi.init", "ti.random")
    ]
    assert calls == ["tiscene/device/runtime.py"]


def test_no_code_names_one_scene():
    """Scenes are data: only the demo command chooses one. Docstrings may give examples."""
    scenes = {folder.name for folder in (ROOT / "usd_scenes").iterdir() if list(folder.glob("scene.usd*"))}
    named = []
    for path in sources("tiscene", "dynamics"):
        if path.name == "demo.py":
            continue
        tree = parsed(path)
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        named += [
            f"{path.relative_to(ROOT)}:{node.lineno}: {node.value!r}"
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings
            if set(node.value.replace("/", " ").split()) & scenes
        ]
    assert not named


def test_files_stay_short():
    """A file past about 350 lines is asking to be two, unless LONG_FOR_A_REASON says why it is not."""
    lines = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in sources(*PACKAGES)}
    assert {path for path, count in lines.items() if count > 400} <= set(LONG_FOR_A_REASON)

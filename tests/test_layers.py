"""The floors of the house: an import may go down, never up.

Read from the source (ast), so that an import inside a function counts as well; what stands under `if TYPE_CHECKING`
does not run and does not count.
"""

import ast
import functools
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("tiscene", "dynamics", "usd_scenes")

GROUND = {"tiscene.validation", "tiscene.errors", "tiscene.files", "tiscene.device", "tiscene.camera", "tiscene.color"}
SCENE = GROUND | {"tiscene.scene"}
STREAM = SCENE | {
    "dynamics",
    "tiscene.catalog",
    "tiscene.stream.incremental",
    "tiscene.frame",
    "tiscene.stream.frame_slice",
    "tiscene.world.lights",
    "tiscene.stream.loading",
    "tiscene.render",
    "tiscene.scenario",
    "tiscene.stream.shutter",
    "tiscene.world.trajectories",
    "tiscene.usd",
    "tiscene.progress",
    "tiscene.world",
}
EXPORT = {
    *("tiscene", "tiscene.errors", "tiscene.files", "tiscene.color"),
    *("tiscene.frame", "tiscene.stream", "tiscene.sailenv.unity_coordinates"),
}

# Each part of the project and the parts that it may import; a part may always import itself.
MAY_IMPORT = {
    "dynamics": set(),
    "usd_scenes": set(),
    "docs.tools.template_sheet": {"usd_scenes", "tiscene", "tiscene.catalog", "tiscene.commands"},
    "docs.tools.gallery": {"usd_scenes", "docs.tools.template_sheet", "tiscene", "tiscene.commands", "tiscene.usd"},
    "docs.tools.imported_models": {
        "usd_scenes",
        "docs.tools.template_sheet",
        *("tiscene", "tiscene.catalog", "tiscene.commands", "tiscene.usd"),
    },
    "tiscene": set(),  # the front door; its names are looked up lazily
    "tiscene.errors": set(),
    "tiscene.files": {"tiscene.errors"},
    "tiscene.device": {"tiscene.errors", "tiscene.files"},
    "tiscene.camera": {"tiscene.errors"},
    "tiscene.scene": GROUND,
    "tiscene.render": SCENE,
    "tiscene.frame.events": set(),
    "tiscene.frame": SCENE | {"tiscene.frame.events", "tiscene.render"},
    "tiscene.stream.frame_slice": {"tiscene.frame"},
    "tiscene.catalog": {"tiscene.errors", "usd_scenes"},
    "tiscene.usd": SCENE | {"tiscene.catalog"},
    "tiscene.scenario.serialization": {"tiscene.errors", "tiscene.files"},
    "tiscene.scenario.edits": {"tiscene.camera", "tiscene.errors", "dynamics"},
    "tiscene.scenario": {
        "tiscene.scenario.edits",
        "tiscene.scenario.light_motion",
        "tiscene.errors",
        "tiscene.camera",
        "tiscene.scenario.serialization",
        "tiscene.catalog",
        "tiscene.randomization.sampler",  # this and usd at need only: writing a scenario down needs neither USD nor Taichi
        "tiscene.usd",
        "dynamics",
    },
    "tiscene.randomization.free_space": SCENE | {"tiscene.render"},
    "tiscene.randomization.ranges": {"tiscene.errors", "dynamics"},
    "tiscene.randomization.sampler": SCENE
    | {
        "tiscene.randomization.ranges",
        "tiscene.randomization.free_space",
        "tiscene.usd",
        "tiscene.catalog",
        "dynamics",
    },
    "tiscene.stream.loading": SCENE | {"tiscene.render", "tiscene.usd"},
    "tiscene.world.frustum_test": {"tiscene.camera"},
    "tiscene.scenario.light_motion": {"tiscene.errors", "dynamics"},
    "tiscene.world.lights": SCENE | {"tiscene.scenario.light_motion"},
    "tiscene.world.animation": SCENE,
    "tiscene.world.object_registry": SCENE
    | {"tiscene.world.animation", "tiscene.scenario.edits", "tiscene.world.lights", "tiscene.scenario"},
    "tiscene.world.stage_objects": SCENE
    | {"tiscene.world.animation", "dynamics", "tiscene.scenario.edits", "tiscene.world.object_registry"},
    "tiscene.world.trajectories": SCENE | {"dynamics", "tiscene.scenario.edits", "tiscene.scenario"},
    "tiscene.world.event_detector": SCENE
    | {
        "tiscene.scenario.edits",
        "tiscene.frame.events",
        "tiscene.world.frustum_test",
        "tiscene.world.object_registry",
        "tiscene.world.trajectories",
        "tiscene.world.stage_objects",
        "dynamics",
    },
    "tiscene.world": SCENE
    | {
        "tiscene.scenario.edits",
        "tiscene.frame.events",
        "tiscene.world.event_detector",
        "tiscene.world.object_registry",
        "tiscene.world.lights",
        "tiscene.world.trajectories",
        "tiscene.world.stage_objects",
        "dynamics",
        "tiscene.scenario",
        "tiscene.catalog",
        "tiscene.usd",
    },
    "tiscene.stream.incremental": SCENE | {"tiscene.render", "tiscene.world"},
    "tiscene.validation": {"tiscene.errors"},
    "tiscene.color": set(),
    "tiscene.stream.shutter": SCENE | {"tiscene.render", "tiscene.world"},
    "tiscene.stream": STREAM,
    "tiscene.progress": set(),
    "tiscene.export": EXPORT,
    "tiscene.sailenv.unity_coordinates": {
        "dynamics",
        "tiscene.camera",
    },  # the only place where coordinates are left-handed
    "tiscene.sailenv": STREAM | {"tiscene.stream", "tiscene.sailenv.unity_coordinates"},
    "tiscene.commands": STREAM | EXPORT | {"tiscene.export", "tiscene.sailenv"},
    "tiscene.cli": {"tiscene", "tiscene.commands", "tiscene.errors"},
    "tiscene.__main__": {"tiscene.cli"},
}

# Packages that may be imported in some places only.
ONLY_IN = {
    "pxr": ("tiscene/usd/", "usd_scenes/author/"),
    "pyoidn": ("tiscene/render/",),
    "OpenEXR": ("tiscene/usd/", "tiscene/export/", "usd_scenes/author/"),
    "PIL": (
        "tiscene/usd/",
        "tiscene/export/",
        "usd_scenes/author/",
        "docs/tools/template_sheet.py",
        "docs/tools/gallery.py",
    ),
    "rich": ("tiscene/commands/",),
    "trimesh": ("tiscene/usd/", "usd_scenes/author/"),
}


# Files past 400 lines, each with its reason.
LONG_FOR_A_REASON: dict[str, str] = {}


def sources(*packages: str) -> list[Path]:
    return [path for package in packages for path in sorted((ROOT / package).rglob("*.py"))]


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def part_of(module: str) -> str:
    """The longest key of MAY_IMPORT that the module is or lies in."""
    keys = [key for key in MAY_IMPORT if module == key or (module.startswith(key + ".") and key != "tiscene")]
    return max(keys, key=len) if keys else module


def running_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Every node but those under `if TYPE_CHECKING`."""
    yield node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        yield from running_nodes(child)


def imported_modules(path: Path) -> set[str]:
    """Absolute names of what a file imports; `from package import name` counts as package.name where that is a file."""
    modules = set()
    for node in running_nodes(parsed(path)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                target = ROOT / full.replace(".", "/")
                is_module = target.with_suffix(".py").is_file() or target.is_dir()
                modules.add(full if is_module else str(node.module))
    return modules


@pytest.mark.parametrize("path", sources(*PACKAGES), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_down(path):
    part = part_of(module_name(path))
    assert part in MAY_IMPORT, f"{part} has no floor: give it a line in MAY_IMPORT"
    own = {part_of(name) for name in imported_modules(path) if name.split(".")[0] in PACKAGES}
    up = own - {part} - MAY_IMPORT[part]
    assert not up, f"{path.relative_to(ROOT)} imports {sorted(up)}; {part} may import {sorted(MAY_IMPORT[part])}"


def test_the_table_itself_has_no_cycle():
    floors: dict[str, int] = {}

    def floor(part: str, above: tuple[str, ...] = ()) -> int:
        assert part not in above, f"cycle: {' -> '.join([*above, part])}"
        if part not in floors:
            floors[part] = 1 + max((floor(below, (*above, part)) for below in MAY_IMPORT[part]), default=-1)
        return floors[part]

    assert floor("dynamics") == 0
    assert floor("tiscene.render") < floor("tiscene.frame") < floor("tiscene.stream") < floor("tiscene.export")
    assert floor("tiscene.scene") < floor("tiscene.world") < floor("tiscene.stream")
    assert floor("tiscene.__main__") == max(floor(part) for part in MAY_IMPORT)


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


def test_kernel_modules_are_those_that_mypy_leaves_out():
    """Taichi reads annotations as values and compiles the bodies itself: mypy cannot, and must not be told to."""
    overrides = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    (left_out,) = [override["module"] for override in overrides if override.get("ignore_errors")]
    assert left_out == kernel_modules()


@pytest.mark.parametrize("module", kernel_modules())
def test_kernel_modules_keep_their_annotations(module):
    path = ROOT / (module.replace(".", "/") + ".py")
    assert "__future__" not in imported_modules(path), "Taichi cannot read annotations that are strings"


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
    assert calls == ["tiscene/device/__init__.py"]


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

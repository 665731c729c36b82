# SPDX-License-Identifier: Apache-2.0
"""Row "storage": full disks, folders that cannot be written, no home and no cache.

Writes fail by a stand-in for the operating system: `full_disk` raises ENOSPC at the n-th write of a process. A small
tmpfs is used as well where this process may mount one.
"""

from __future__ import annotations

import builtins
import contextlib
import errno
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.stress.child_process import ROOT, ChildFailed, call
from tests.stress.killed_processes import FRAMES, HERE, contents, torn_files, write_model
from tests.stress.outcomes import Outcome, count

SELF = "tests.stress.unwritable_storage"
NOWHERE = "/dev/null/x"  # below a file, where no folder can be created, not even by root
FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextlib.contextmanager
def full_disk(folder: Path, allowed: int) -> Iterator[None]:
    """Let only the first `allowed` files below a folder be written; of later ones half the data, then ENOSPC."""
    opened = builtins.open
    written = 0

    class HalfWriter(io.FileIO):
        """A file on a full disk."""

        def write(self, data: Any) -> int:
            super().write(memoryview(data)[: len(data) // 2])
            raise FULL

    def limited(file: Any, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        nonlocal written
        is_inside = isinstance(file, str | os.PathLike) and Path(file).resolve().is_relative_to(folder)
        if not is_inside or not set(mode) & set("wax+"):
            return opened(file, mode, *arguments, **options)
        written += 1
        return opened(file, mode, *arguments, **options) if written <= allowed else HalfWriter(file, "w")

    folder = folder.resolve()
    builtins.open, before = limited, io.open
    io.open = limited  # pathlib uses this name
    try:
        yield
    finally:
        builtins.open, io.open = opened, before


def export_on_full_disk(folder: str, allowed: list[int]) -> list[str]:
    """Run in a child process: export with a disk that is full after some files; return the errors."""
    import tiscene as ts
    from tests.stress.steady_state import SIZE, scenario
    from tiscene.errors import TisceneError
    from tiscene.export import export

    stream, errors = ts.Stream(scenario(), quality="fast", base_spp=4, **SIZE), []
    for number in allowed:
        with full_disk(Path(folder), number):
            try:
                export(stream, folder, frames=range(FRAMES))
                errors.append("")
            except TisceneError as error:
                errors.append(str(error))
    return errors


def full_during_export(uses: int, folder: Path) -> Outcome:
    """Export with a disk that is full after more and more files, in one folder; then resume."""
    use = f"{uses} exports, the disk full in the middle of the n-th file, then resume"
    call(f"{HERE}:export_frames", str(folder / "whole"))
    whole = contents(folder / "whole")
    output = folder / "full"
    allowed = [1 + number * len(whole) // uses for number in range(uses)]
    errors = call(f"{SELF}:export_on_full_disk", str(output), allowed)
    unclear = [error for error in errors if "No space left" not in error or str(output) not in error]
    torn = torn_files(contents(output), whole) if output.exists() else []
    call(f"{HERE}:export_frames", str(output))
    same = contents(output) == whole
    figures = f"{len(unclear)} without a clear error {unclear[:1]}; {len(torn)} torn files; resumed: same bytes: {same}"
    return Outcome(use, figures, not unclear and not torn and same)


def run_in_mount_namespace(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a shell command in a mount namespace of its own, in which `folder` may be mounted."""
    line = ["unshare", "--mount", "sh", "-c", command]
    return subprocess.run(line, capture_output=True, text=True, cwd=folder, timeout=600, check=False)


def full_tmpfs(folder: Path) -> Outcome | None:
    """Export through the command line into a tmpfs of 512 kB; None where it cannot be mounted."""
    mounted = folder / "small"
    mounted.mkdir()
    render = (
        f"cd {ROOT} && {sys.executable} -W ignore -m tiscene render object_view --width 256 --height 192 --format npz "
        f"--buffers depth,instance --frames 0:20 -o {mounted}/out; echo status $?; rm {mounted}/filler; "
        f"{sys.executable} -W ignore -m tiscene render object_view --width 256 --height 192 --format npz "
        f"--buffers depth,instance --frames 0:2 -o {mounted}/out; echo status $?"
    )
    fill = f"head -c 400000 /dev/zero > {mounted}/filler"
    done = run_in_mount_namespace(f"mount -t tmpfs -o size=512k none {mounted} && {fill} && {{ {render} ; }}", folder)
    if "status" not in done.stdout:
        return None
    statuses = [line.split()[1] for line in done.stdout.splitlines() if line.startswith("status")]
    is_clear = "No space left" in done.stderr and "Traceback" not in done.stderr
    figures = f"exit status {statuses[0]}, clear error: {is_clear}; after space was freed: exit status {statuses[1]}"
    return Outcome(
        "`tiscene render` onto a tmpfs of 512 kB that fills up", figures, statuses == ["2", "0"] and is_clear
    )


def without_folders() -> list[Outcome]:
    """Render without a home, and with cache folders that cannot be created or written."""
    expected = call(f"{HERE}:render_digest")
    uses = {
        "render without HOME": {"HOME": None},
        "render with a base image cache that cannot be created": {"TISCENE_CACHE": NOWHERE},
        "render with a device in place of the cache folder": {"TISCENE_CACHE": "/dev/full"},
    }
    outcomes = []
    for use, env in uses.items():
        try:
            found = call(f"{HERE}:render_digest", env=env)
            outcomes.append(Outcome(use, f"same frame: {found == expected}", found == expected))
        except ChildFailed as error:
            outcomes.append(Outcome(use, str(error), False))
    return outcomes


def export_into(folder: str) -> str:
    """Run in a child process: export one frame; return the error, "" for none."""
    import tiscene as ts
    from tiscene.errors import TisceneError
    from tiscene.export import export

    try:
        export(ts.Stream("object_view", width=16, height=12, buffers=("depth",)), folder, frames=range(1))
    except TisceneError as error:
        return str(error)
    return ""


def import_into(model: str, folder: str) -> str:
    """Run in a child process: import a model; return the error, "" for none."""
    from tiscene.errors import TisceneError
    from tiscene.usd.importers.import_template import import_asset

    try:
        import_asset(model, folder)
    except TisceneError as error:
        return str(error)
    return ""


def unwritable_output(folder: Path) -> Outcome:
    """Export and import into places that cannot be written."""
    model = str(write_model(folder / "model"))
    places = ["/dev/null/out", "/proc/out", str(folder / "model" / "grid.obj")]
    errors = [call(f"{SELF}:export_into", place) for place in places]
    errors += [call(f"{SELF}:import_into", model, place) for place in places]
    clear = [
        (place in error and "cannot be written" in error) or "cannot write" in error
        for place, error in zip([*places, *places], errors, strict=True)
    ]
    unclear = [error for error, is_clear in zip(errors, clear, strict=True) if not is_clear]
    use = f"export and import into {len(places)} places that cannot be written"
    return Outcome(use, f"{len(unclear)} without a clear error {unclear[:1]}", not unclear)


def rows(scale: float) -> Iterator[Outcome]:
    """Run the row; scale 1 is the full count."""
    with tempfile.TemporaryDirectory(prefix="tiscene-stress-") as name:
        folder = Path(name)
        yield full_during_export(count(20, scale, 3), folder)
        mounted = full_tmpfs(folder)
        if mounted is not None:
            yield mounted
        yield unwritable_output(folder)
        yield from without_folders()

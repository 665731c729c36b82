# SPDX-License-Identifier: Apache-2.0
"""Benchmark suites by name: courses that are shipped as files, in three grades of difficulty."""

from __future__ import annotations

from pathlib import Path

from tiscene.errors import UnknownName
from tiscene.learning.course import Course

FOLDER = Path(__file__).parent / "suites"
DEFAULT_GRADE = "medium"


def suites() -> dict[str, Path]:
    """Return the files of all suites by name: "room-easy", "room-medium", "room-hard", and "room" for medium."""
    files = {path.stem: path for path in sorted(FOLDER.glob("*.json"))}
    short = {name.removesuffix(f"-{DEFAULT_GRADE}"): path for name, path in files.items()}
    return short | files


def load_course(name: str) -> Course:
    """Return a course by the name of a suite or by its file.

    Raises:
        UnknownName: there is no such suite, and no such file.
        MissingFile, ArgumentError, ScenarioError: the file cannot be read.
    """
    if name in suites():
        return Course.load(suites()[name])
    if Path(name).suffix.lower() != ".json":
        raise UnknownName("suite", name, suites(), hint="Your own course: a file that ends in .json.")
    return Course.load(name)

# SPDX-License-Identifier: Apache-2.0
"""All exceptions and warnings that tiscene raises on purpose.

Each class also inherits the built-in exception that a caller would catch::

    TisceneError
    ├── UnknownName (LookupError)         a name that is not in a list of names; suggests the nearest one
    │   ├── SceneNotFound                 no such scene, and no such file
    │   ├── TemplateNotFound              no such object template
    │   ├── ObjectNotFound                no live object of that name or id
    │   ├── CameraNotFound                no such camera on the stage
    │   ├── LightNotFound                 no such light on the stage
    │   ├── MaterialNotFound              no such material on the stage or in a template
    │   └── BufferNotFound (KeyError, AttributeError)  no such buffer
    ├── MissingFile (FileNotFoundError)   a file that the user named does not exist
    ├── StageError (ValueError)           a USD stage that cannot be rendered; lists every problem with its prim path
    ├── ScenarioError (ValueError)        a scenario that contradicts itself or its scene
    ├── ArgumentError (ValueError)        an argument outside its range or of the wrong type
    │   └── ArgumentTypeError (TypeError)  an argument of the wrong type
    ├── ExportError (RuntimeError)        an output folder or file that cannot be written or continued
    ├── MissingExtra (ImportError)        a library that is installed with an extra, `pip install 'tiscene[NAME]'`
    └── DeviceError (RuntimeError)        Taichi cannot run as requested

    StageWarning (UserWarning)            content of a stage that is left out or approximated

TisceneError and the argument errors are defined in `dynamics.errors`, since `dynamics` imports nothing from here.
"""

from __future__ import annotations

import contextlib
import difflib
import os
from collections.abc import Iterable, Iterator, Sequence

from dynamics.errors import ArgumentError, ArgumentTypeError, TisceneError, counted, did_you_mean

__all__ = [
    "ArgumentError",
    "ArgumentTypeError",
    "BufferNotFound",
    "CameraNotFound",
    "DeviceError",
    "ExportError",
    "LightNotFound",
    "MaterialNotFound",
    "MissingExtra",
    "MissingFile",
    "ObjectNotFound",
    "ScenarioError",
    "SceneNotFound",
    "StageError",
    "StageWarning",
    "TemplateNotFound",
    "TisceneError",
    "UnknownName",
    "counted",
    "did_you_mean",
    "export_errors",
    "requires_extra",
    "scenario_errors",
]


class UnknownName(TisceneError, LookupError):
    """A name that is not among the known ones.

    Attributes:
        name: The name that was requested, as it was passed.
        known: The known names, sorted.
    """

    def __init__(self, kind: str, name: str | int, known: Iterable[str], where: str = "", hint: str = "") -> None:
        """Compose the message; it suggests the nearest known name, or lists all if there are 30 or fewer.

        Args:
            kind: What was looked up, such as "template".
            name: The name that was requested, or a number, which is never taken for a misspelt name.
            known: The names that exist.
            where: Where it was looked up, with a leading space, such as " in scene 'room_02'".
            hint: A closing sentence.
        """
        known = sorted(known)
        requested = name if isinstance(name, str) else ""  # `name` may be of any type
        message = f"no {kind} {repr(name) if isinstance(name, str) else name}{where}."
        folded = {candidate.casefold(): candidate for candidate in known}
        nearest = difflib.get_close_matches(requested.casefold(), folded, n=1, cutoff=0.5)
        if nearest:
            message += f" Did you mean {folded[nearest[0]]!r}?"
        elif 0 < len(known) <= 30:
            message += f" There are: {', '.join(known)}."
        if hint:
            message += f" {hint}"
        super().__init__(message)
        self.name = name
        self.known = known


class SceneNotFound(UnknownName):
    """No scene of that name is shipped or on the search path."""


class TemplateNotFound(UnknownName):
    """No object template of that name can be spawned."""


class ObjectNotFound(UnknownName):
    """No live object has that name or id."""


class CameraNotFound(UnknownName):
    """The stage holds no camera of that name."""


class LightNotFound(UnknownName):
    """The stage holds no light of that name or path."""


class MaterialNotFound(UnknownName):
    """Neither the stage nor a template holds a material of that name or path."""


class BufferNotFound(UnknownName, KeyError, AttributeError):  # type: ignore[misc]  # AttributeError.name may be None
    """No per-pixel buffer has that name.

    Also an AttributeError, so that `hasattr(frame, name)` works, and a KeyError, so that `frame.get(name)` works.
    """

    __str__ = Exception.__str__  # KeyError would quote the message


class MissingFile(TisceneError, FileNotFoundError):
    """A file that the user named does not exist."""


class StageError(TisceneError, ValueError):
    """A USD stage that cannot be rendered.

    Attributes:
        stage: Name or path of the stage.
        problems: One line for each problem, beginning with the prim path.
        advice: What to do about them. "": the problems say it.
    """

    def __init__(self, stage: str, problems: Sequence[str], advice: str = "") -> None:
        lines = [f"{stage} has {counted(len(problems), 'problem')}:", *(f"  {problem}" for problem in problems)]
        super().__init__("\n".join([*lines, advice] if advice else lines))
        self.stage = stage
        self.problems = tuple(problems)
        self.advice = advice


class ScenarioError(TisceneError, ValueError):
    """A scenario that contradicts itself or its scene."""


@contextlib.contextmanager
def scenario_errors() -> Iterator[None]:
    """Convert TypeError and ValueError, such as those of `dynamics`, to ScenarioError with the same message."""
    try:
        yield
    except ScenarioError:
        raise
    except (TypeError, ValueError) as error:
        raise ScenarioError(str(error)) from error


@contextlib.contextmanager
def export_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Convert an OSError while writing the file or folder `path` to ExportError. Errors of tiscene stay as they are."""
    try:
        yield
    except TisceneError:  # MissingFile is of what was to be read
        raise
    except FileExistsError as error:  # where a folder is to be made
        place = "it" if error.filename == os.fspath(path) else repr(error.filename)
        raise ExportError(f"cannot write {os.fspath(path)!r}: {place} is a file, not a folder") from error
    except OSError as error:
        raise ExportError(f"cannot write {os.fspath(path)!r}: {error}") from error


class ExportError(TisceneError, RuntimeError):
    """An output folder or file that cannot be written or continued."""


class MissingExtra(TisceneError, ImportError):
    """A library is not installed; the message names the extra that installs it."""


@contextlib.contextmanager
def requires_extra(extra: str) -> Iterator[None]:
    """Convert the ImportError of an optional library, imported in the block, to MissingExtra.

    Args:
        extra: The extra in pyproject.toml that installs the library.
    """
    try:
        yield
    except ImportError as error:
        library = (error.name or str(error)).split(".")[0]
        raise MissingExtra(f"{library} is not installed: pip install 'tiscene[{extra}]'") from error


class DeviceError(TisceneError, RuntimeError):
    """Taichi cannot run as requested."""


class StageWarning(UserWarning):
    """Content of a stage that is left out or approximated."""

# SPDX-License-Identifier: Apache-2.0
"""Every error that tiscene raises on purpose.

::

    TisceneError
    ├── UnknownName (LookupError)         a name that is not in a list of names; tells the nearest one
    │   ├── SceneNotFound                 no such scene, and no such file
    │   ├── TemplateNotFound              no such object template
    │   ├── ObjectNotFound                no live object of that name or id
    │   ├── CameraNotFound                no such camera on the stage
    │   ├── LightNotFound                 no such light on the stage
    │   └── BufferNotFound (AttributeError)  no such buffer
    ├── MissingFile (FileNotFoundError)   a file that the user named is not there
    ├── StageError (ValueError)           a USD stage that cannot be rendered; lists every problem with its prim path
    ├── ScenarioError (ValueError)        a scenario that contradicts itself or its scene
    ├── ArgumentError (ValueError)        an argument outside its range or of the wrong kind
    ├── ExportError (RuntimeError)        an output folder or file that cannot be written or continued
    └── DeviceError (RuntimeError)        Taichi cannot run as asked

    StageWarning (UserWarning)            what a stage holds that is left out or approximated
"""

from __future__ import annotations

import contextlib
import difflib
import os
from collections.abc import Iterable, Iterator, Sequence
from typing import Any


class TisceneError(Exception):
    """Base of all errors below."""

    def __reduce__(self) -> tuple[Any, ...]:
        """As it is, whatever its arguments were: a worker process hands its errors on by pickling them."""
        return _raised_elsewhere, (type(self), self.args, self.__dict__)


class UnknownName(TisceneError, LookupError):
    """A name that is not among the known ones."""

    def __init__(self, kind: str, name: str, known: Iterable[str], where: str = "", hint: str = "") -> None:
        """kind: what was looked for ("template"); where: " in scene 'room_02'"; hint: a closing sentence."""
        known = sorted(known)
        message = f"no {kind} {name!r}{where}."
        wanted = str(name)  # whatever the user passed
        nearest = difflib.get_close_matches(wanted, known, n=1, cutoff=0.5) or [
            candidate for candidate in known if candidate.casefold() == wanted.casefold()
        ]
        if nearest:
            message += f" Did you mean {nearest[0]!r}?"
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


class BufferNotFound(UnknownName, AttributeError):  # type: ignore[misc]  # a `name` that is never None is fine
    """No per-pixel buffer has that name. An AttributeError too, so that `hasattr(frame, name)` is an answer."""


class MissingFile(TisceneError, FileNotFoundError):
    """A file that the user named is not there."""


class StageError(TisceneError, ValueError):
    """A USD stage that cannot be rendered. `problems` holds one line each, beginning with the prim path."""

    def __init__(self, stage: str, problems: Sequence[str]) -> None:
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        super().__init__(f"{stage} has {count}:\n" + "\n".join(f"  {problem}" for problem in problems))
        self.stage = stage
        self.problems = tuple(problems)


class ScenarioError(TisceneError, ValueError):
    """A scenario that contradicts itself or its scene."""


@contextlib.contextmanager
def scenario_errors() -> Iterator[None]:
    """What the checks of `dynamics` raise, as ScenarioError."""
    try:
        yield
    except ScenarioError:
        raise
    except (TypeError, ValueError) as error:
        raise ScenarioError(str(error)) from error


@contextlib.contextmanager
def export_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Raise failures to write the file `path` as ExportError."""
    try:
        yield
    except OSError as error:
        raise ExportError(f"cannot write {os.fspath(path)!r}: {error}") from error


class ArgumentError(TisceneError, ValueError):
    """An argument outside its range or of the wrong kind."""


class ExportError(TisceneError, RuntimeError):
    """An output folder or file that cannot be written or continued."""


class DeviceError(TisceneError, RuntimeError):
    """Taichi cannot run as asked."""


class StageWarning(UserWarning):
    """What a stage holds that is left out or approximated."""


def _raised_elsewhere(kind: type[TisceneError], args: tuple[Any, ...], members: dict[str, Any]) -> TisceneError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(members)
    return error

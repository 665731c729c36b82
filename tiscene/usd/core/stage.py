# SPDX-License-Identifier: Apache-2.0
"""Open USD stages: composition errors are reported, variants selected, and USD's diagnostics kept off the terminal."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from numbers import Real
from pathlib import Path

from pxr import Ar, Sdf, Tf, Usd, UsdUtils

from tiscene import catalog
from tiscene.errors import ArgumentError, MissingFile, StageError, UnknownName, counted
from tiscene.usd.core import schema
from tiscene.usd.core.package import split_package
from tiscene.usd.core.prims import distinct_prims
from tiscene.usd.core.report import COMPOSITION, StageReport, error_lines, one_line
from tiscene.usd.core.value_times import has_spline
from tiscene.usd.materials.materialx_document import is_substituted, substitute_documents

schema.register()

Variants = Mapping[str, str | Mapping[str, str]]
_MAX_VARIANT_PRIMS = 30  # prims with variant sets that an error lists
_REASON = " -- "
_INTRODUCED = r"introduced by @[^@]*@"
_ASSET = re.compile(r"@([^@]+)@")
_OLDEST_CRATE = (0, 4, 0)  # format of binary files that usd-core reads
_METERS = "metersPerUnit"
_DEFAULT_METERS = 0.01


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep USD's diagnostics off stdout and stderr; the reader raises or warns about those that matter."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        delegate.TakeUncoalescedDiagnostics()  # a delegate prints its remaining diagnostics when it is destroyed
        del delegate


def _advice_on_file(path: str | Path, lines: list[str]) -> str:
    """Return how a file that USD does not take for one of its own begins; "" for other errors."""
    if not any(text in line for line in lines for text in ("Failed to open layer", "is not a valid")):
        return ""
    size = Path(path).stat().st_size
    with open(path, "rb") as file:
        start = file.read(8)
    begins = f"It has {counted(size, 'byte')} and begins with {start!r}" if size else "It is empty"
    return f"{begins}: copy or export it again, or give it the suffix of its format."


@contextlib.contextmanager
def readable(path: str | Path) -> Iterator[None]:
    """Raise USD's exceptions, and texts that are not UTF-8, as StageError of the file `path`."""
    try:
        yield
    except Tf.ErrorException as error:
        advice = old_crate_advice(str(path))
        lines = [f"cannot be read: {advice}"] if advice else [f"cannot be read: {line}" for line in error_lines(error)]
        raise StageError(str(path), lines, _advice_on_file(path, lines)) from None
    except UnicodeDecodeError as error:
        raise StageError(str(path), [f"cannot be read: a text in it is not valid UTF-8: {error}"]) from None


def open_stage(path: str | Path, variants: Variants | None = None, report: StageReport | None = None) -> Usd.Stage:
    """Open a stage with every payload loaded and variants selected in its session layer.

    A unit of length that is invalid, or a float instead of a double (Blender 2.8), is corrected in the session layer.

    Args:
        path: the file.
        variants: variant selections, `{"/Room{lighting}": "night"}` or `{"/Room": {"lighting": "night"}}`.
        report: receives layers that are missing, and everything else that does not compose, as problems. None: they
            are ignored.

    Raises:
        MissingFile: there is no such file.
        StageError: the file cannot be read, or its time codes are invalid.
        UnknownName: a prim, variant set or variant that the stage does not have.
        ArgumentError: `variants` is malformed.
    """
    path = Path(path)
    if not path.exists():
        raise MissingFile(f"{path} does not exist")
    if not path.is_file():
        raise MissingFile(f"{path} is not a file: name the .usd, .usda, .usdc or .usdz file itself")
    context = resolver_context(path)
    with readable(path), Ar.ResolverContextBinder(context):
        stage = Usd.Stage.Open(str(path), context, Usd.Stage.LoadAll)
        for layer in stage.GetUsedLayers():  # USD shares layers in a process: the files may have changed since
            # One that the layers reloaded before it no longer use has expired.
            if not layer.expired and not layer.anonymous and (not layer.dirty or is_substituted(layer)):
                layer.Reload(force=layer.dirty)
        report = report or StageReport(str(path))
        for file, fault in substitute_documents(stage, report.root.contains):
            report.problem("/", "MaterialX", f"@{file}@ {fault}")
    try:
        select_variants(stage, variants or {})
    except UnknownName:
        missing = StageReport(str(path))  # a variant may be missing because a file of its prim is
        _report_composition(stage, missing, [Sdf.Path(prim) for prim, _, _ in _selections(variants or {})])
        missing.raise_problems()
        raise
    _report_composition(stage, report)
    _report_missing_clips(stage, report)
    _correct_unit(stage, report)
    _refuse_time_codes(stage, report)
    report.raise_refused()
    _set_missing_range(stage)
    return stage


def resolver_context(path: str | Path) -> Ar.DefaultResolverContext:
    """Return where the asset paths of a file that do not begin with "./" or "../" are looked for.

    In the file's own folder, then in the folders of scenes (`catalog.search_path`): saved layers refer to the scenes
    and templates of the catalog as `room_02/scene.usda`.
    """
    folders = [Path(path).resolve().parent, *(folder.resolve() for folder in catalog.search_path())]
    return Ar.DefaultResolverContext([str(folder) for folder in folders])


def _report_composition(stage: Usd.Stage, report: StageReport, prims: Sequence[Sdf.Path] | None = None) -> None:
    """Report everything that does not compose, such as references to files that do not exist.

    USD composes in several threads: the order of its errors varies, and which of those of one file have the reason.

    Args:
        stage: the stage.
        report: receives the problems.
        prims: only those of these prims and of prims above them; None: all.
    """
    faults: list[tuple[str, str]] = []
    reasons: dict[str, str] = {}
    for error in stage.GetCompositionErrors():
        path = _error_path(error)
        if prims is None or any(each.HasPrefix(path) for each in prims):
            text = one_line(error).rstrip(" .")
            text = re.sub(rf"({_INTRODUCED})<{re.escape(path)}>", r"\1", text)  # prims of one cause share a line
            fault, _, reason = text.partition(_REASON)
            faults.append((path, fault))
            reasons[fault] = max(reason, reasons.get(fault, ""))
    for path, fault in sorted(faults):
        text = f"{fault}{_REASON}{reasons[fault]}" if reasons[fault] else fault
        advice = next((found for asset in _ASSET.findall(text) if (found := old_crate_advice(asset))), "")
        report.problem(path, COMPOSITION, f"{text}: {advice}" if advice else text)


def _report_missing_clips(stage: Usd.Stage, report: StageReport) -> None:
    """Report files of value clips that do not exist: USD composes the stage without them, and without an error."""
    for prim in filter(_has_clips, distinct_prims(stage)):
        with report.guard(prim):
            clips = Usd.ClipsAPI(prim)
            for name in clips.GetClips():
                for asset in clips.ComputeClipAssetPaths(name):
                    if not asset.resolvedPath:
                        text = f"Could not open asset @{asset.path}@ for the value clips {name}"
                        report.problem(prim.GetPath(), COMPOSITION, text)


def _has_clips(prim: Usd.Prim) -> bool:
    return bool(prim.HasAuthoredMetadata("clips"))


def _correct_unit(stage: Usd.Stage, report: StageReport) -> None:
    """Author a valid unit of length in the session layer; an invalid one is reported."""
    layer = stage.GetRootLayer().pseudoRoot
    if not layer.HasInfo(_METERS):
        return
    value = float(layer.GetInfo(_METERS))
    if not 0.0 < value < math.inf:
        report.problem("/", "stage", f"{_METERS} is {value:g}; USD's default of {_DEFAULT_METERS} m is used")
        value = _DEFAULT_METERS
    stage.GetSessionLayer().pseudoRoot.SetInfo(_METERS, value)  # as a double, whatever type the file has


def _refuse_time_codes(stage: Usd.Stage, report: StageReport) -> None:
    """Refuse time codes that are not finite or do not advance: USD scales all time samples by their rate."""
    rate = stage.GetTimeCodesPerSecond()
    if not 0.0 < rate < math.inf:
        report.refuse("/", "stage", f"timeCodesPerSecond is {rate:g}; it must be positive, such as 24")
    for name, value in (("startTimeCode", stage.GetStartTimeCode()), ("endTimeCode", stage.GetEndTimeCode())):
        if not math.isfinite(value):
            report.refuse("/", "stage", f"{name} is {value:g}; it must be a number")


def old_crate_advice(file: str) -> str:
    """Return what to do about a binary USD file that is too old for the installed USD library; "" if it is not."""
    try:
        with open(split_package(file)[0], "rb") as stream:
            head = stream.read(11)
    except (OSError, ValueError):
        return ""
    if len(head) < 11 or not head.startswith(b"PXR-USDC") or tuple(head[8:]) >= _OLDEST_CRATE:
        return ""
    version, oldest = ".".join(map(str, head[8:])), ".".join(map(str, _OLDEST_CRATE))
    return (
        f"{file} is of version {version} of USD's binary format, and the installed USD library reads {oldest} and "
        "later: convert it once with an older library, in an environment of its own: pip install usd-core==24.11; "
        "python -c \"from pxr import Sdf; Sdf.Layer.FindOrOpen('old.usdc').Export('new.usdc')\""
    )


def _error_path(error: object) -> str:
    try:
        return str(error.rootSite.path)  # type: ignore[attr-defined]
    except (AttributeError, UnicodeDecodeError):
        return "/"


def _set_missing_range(stage: Usd.Stage) -> None:
    """Set the time code range of an animated stage without one to the range of its time samples."""
    if stage.HasAuthoredTimeCodeRange() or not _has_time_samples(stage):
        return
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    samples = [each.GetTimeSamples() for prim in prims for each in prim.GetAuthoredAttributes()]
    times = [time for each in samples if each for time in (each[0], each[-1])]
    if times:
        session = stage.GetSessionLayer()
        session.startTimeCode, session.endTimeCode = min(times), max(times)


def select_variants(stage: Usd.Stage, variants: Variants, layer: Sdf.Layer | None = None) -> None:
    """Select variants.

    Args:
        stage: the stage.
        variants: `{"/Room{lighting}": "night"}` or `{"/Room": {"lighting": "night"}}`.
        layer: layer of the stage to author the selections in; None: the session layer, so that no file changes.

    Raises:
        UnknownName: a prim, variant set or variant that the stage does not have.
        ArgumentError: `variants` is malformed.
    """
    if not isinstance(variants, Mapping):
        raise ArgumentError(f"variants={variants!r} must be a mapping such as {{'/Room{{lighting}}': 'night'}}")
    pending = list(_selections(variants))
    with Usd.EditContext(stage, layer or stage.GetSessionLayer()):
        while pending:  # one may bring along the prim or the variant set of another, in whichever order they are
            errors: dict[tuple[str, str, str], UnknownName] = {}
            for each in pending:
                try:
                    _select(stage, *each)
                except UnknownName as error:
                    errors[each] = error
            if len(errors) == len(pending):
                raise errors[pending[0]]
            pending = list(errors)


def _select(stage: Usd.Stage, prim_path: str, set_name: str, choice: str) -> None:
    prim = stage.GetPrimAtPath(prim_path)
    if not prim:
        raise UnknownName("prim", prim_path, _paths_with_variants(stage), hint="Variants are selected on it.")
    sets = prim.GetVariantSets()
    if set_name not in sets.GetNames():
        raise UnknownName("variant set", set_name, sets.GetNames(), where=f" on <{prim_path}>")
    names = sets.GetVariantSet(set_name).GetVariantNames()
    if choice not in names:
        raise UnknownName("variant", choice, names, where=f" in <{prim_path}>{{{set_name}}}")
    sets.GetVariantSet(set_name).SetVariantSelection(choice)


def _selections(variants: Variants) -> Iterator[tuple[str, str, str]]:
    """Yield (prim path, variant set, variant) for both notations of a selection."""
    for key, value in variants.items():
        if not isinstance(key, str):
            raise ArgumentError(f"variants: {key!r} must be the path of a prim, such as '/Room{{lighting}}'")
        if isinstance(value, str):
            prim_path, brace, rest = key.partition("{")
            if not brace or not rest.endswith("}"):
                raise ArgumentError(f"variants: {key!r} must name a variant set, as in '/Room{{lighting}}'")
            choices: Mapping[str, str] = {rest[:-1]: value}
        else:
            prim_path, choices = key, value
        if not isinstance(choices, Mapping) or not all(isinstance(each, str) for each in choices.values()):
            raise ArgumentError(f"variants: {key!r}: {value!r} must be the name of a variant, or such names by set")
        if not Sdf.Path.IsValidPathString(prim_path) or not Sdf.Path(prim_path).IsAbsoluteRootOrPrimPath():
            raise ArgumentError(f"variants: {prim_path!r} is not the path of a prim, such as '/Room'")
        for set_name, choice in choices.items():
            yield prim_path, set_name, choice


def _paths_with_variants(stage: Usd.Stage) -> list[str]:
    return [str(prim.GetPath()) for prim in stage.TraverseAll() if prim.HasVariantSets()][:_MAX_VARIANT_PRIMS]


def reading_time(stage: Usd.Stage, time_code: float | None) -> Usd.TimeCode:
    """Return the time code to read a stage at.

    Args:
        stage: the stage.
        time_code: finite number; None: the start of the stage's range, else the earliest sample of each attribute.

    Raises:
        ArgumentError: not a finite number.
    """
    if time_code is not None:
        try:
            code = float(time_code) if isinstance(time_code, Real) else math.nan
        except OverflowError:
            code = math.inf
        if not math.isfinite(code):
            raise ArgumentError(f"time_code={time_code!r}: must be a finite number")
        return Usd.TimeCode(code)
    if stage.HasAuthoredTimeCodeRange():
        return Usd.TimeCode(stage.GetStartTimeCode())
    return Usd.TimeCode.EarliestTime()


def changes_over_time(stage: Usd.Stage) -> bool:
    """Return whether anything on a stage has time samples, in its layers or in value clips, or a spline."""
    if _has_time_samples(stage):
        return True
    return any(has_spline(each) for prim in distinct_prims(stage) for each in prim.GetAuthoredAttributes())


def _has_time_samples(stage: Usd.Stage) -> bool:
    if any(layer.ListAllTimeSamples() for layer in stage.GetUsedLayers()):
        return True
    return any(map(_has_clips, distinct_prims(stage)))

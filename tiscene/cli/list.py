# SPDX-License-Identifier: Apache-2.0
"""`tiscene list`: what can be asked for by name: scenes, templates, buffers."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from tiscene import catalog
from tiscene.frame.buffers import BUFFERS


def run(args: argparse.Namespace) -> None:
    """Print the names of scenes and templates with their files, those of buffers with what they mean."""
    _print("Scenes", catalog.scenes())
    _print("Templates", catalog.templates())
    _print("Buffers", {name: aov.doc for name, aov in BUFFERS.items()})


def _print(title: str, lines: Mapping[str, object]) -> None:
    print(f"{title}:" if lines else f"{title}: none")
    width = max((len(name) for name in lines), default=0)
    for name, what in lines.items():
        print(f"  {name:<{width}}  {what}")

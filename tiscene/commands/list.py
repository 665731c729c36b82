"""`tiscene list`: the scenes and templates that have a name."""

from __future__ import annotations

import argparse

from tiscene import catalog


def run(args: argparse.Namespace) -> None:
    """Print the names and the files."""
    for title, files in (("Scenes", catalog.scenes()), ("Templates", catalog.templates())):
        print(f"{title}:" if files else f"{title}: none")
        width = max((len(name) for name in files), default=0)
        for name, path in files.items():
            print(f"  {name:<{width}}  {path}")

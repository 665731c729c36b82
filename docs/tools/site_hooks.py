# SPDX-License-Identifier: Apache-2.0
"""Hooks of MkDocs: navigation, and pages of the site that are not files of docs/.

The navigation is that of docs/index.md. The README, CONTRIBUTING and the changelog lie beside docs/, since a repository
has them there. The page of commands is made from the parser.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
BESIDE = {"README.md": "readme.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}


COMMANDS = "commands.md"


def on_config(config: Any) -> Any:
    """Make the navigation: a section for each heading of the index that has links to pages (an event of MkDocs)."""
    config.nav = [{"Home": ["index.md", BESIDE["README.md"]]}]
    for section in re.split(r"^## ", (ROOT / "docs" / "index.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        pages = [
            BESIDE.get(link.removeprefix("../"), link)
            for link in re.findall(r"^\| \[[^]]*\]\(([^)]+)\)", section, re.M)
        ]
        title = section.splitlines()[0]
        if title == "Reference":
            pages.append(COMMANDS)
        if pages:
            config.nav.append({title: pages})
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages (an event of MkDocs)."""
    from mkdocs.structure.files import File

    for name, page in BESIDE.items():
        files.append(File.generated(config, page, content=_from_root((ROOT / name).read_text(encoding="utf-8"))))
    files.append(File.generated(config, COMMANDS, content=command_page()))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links to files beside docs/ to their pages (an event of MkDocs)."""
    up = "../" * page.file.src_uri.count("/")
    for name, target in BESIDE.items():
        markdown = re.sub(rf"\]\((?:\.\./)+{re.escape(name)}", f"]({up}{target}", markdown)
    return markdown


def _from_root(text: str) -> str:
    """Return a page beside docs/ with the links that it has as a page in docs/."""
    for name, target in BESIDE.items():
        text = text.replace(f"]({name}", f"]({target}")
    return re.sub(r"\]\(docs/", "](", text)


def command_page() -> str:
    """Return the page of all commands and their arguments."""
    from tiscene.cli.parser import parser

    top = parser()
    parts = ["# Command line", "", f"{top.description} `tiscene COMMAND --help` prints the same.", ""]
    for action in top._actions:
        if isinstance(action, argparse._SubParsersAction):
            summaries = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, command in action.choices.items():
                parts += _command(f"tiscene {name}", command, summaries.get(name, ""))
    return "\n".join(parts)


def _command(name: str, command: argparse.ArgumentParser, summary: str) -> list[str]:
    """Return the lines of a command, and of its own commands."""
    text = command.description or f"{summary[:1].upper()}{summary[1:]}"
    lines = [f"## {name}", "", f"{_escaped(text)}{'' if text.endswith('.') else '.'}", ""]
    arguments = [
        each for each in command._actions if not isinstance(each, argparse._SubParsersAction | argparse._HelpAction)
    ]
    if arguments:
        lines += ["| Argument | Meaning |", "|---|---|"]
        formatter = command._get_formatter()
        for each in arguments:
            metavar = (
                formatter._format_args(each, formatter._get_default_metavar_for_optional(each))
                if each.nargs != 0
                else ""
            )
            names = ", ".join(each.option_strings) or formatter._metavar_formatter(each, each.dest)(1)[0]
            shown = f"{names} {metavar}".strip() if each.option_strings else names
            lines.append(f"| `{shown.replace('|', '&#124;')}` | {_escaped(formatter._expand_help(each))} |")
        lines.append("")
    for each in command._actions:
        if isinstance(each, argparse._SubParsersAction):
            summaries = {choice.dest: choice.help or "" for choice in each._choices_actions}
            for sub, parser in each.choices.items():
                lines += _command(f"{name} {sub}", parser, summaries.get(sub, ""))
    return lines


def _escaped(text: str) -> str:
    return text.replace("|", "&#124;").replace("<", "&lt;").replace("*", "&#42;")

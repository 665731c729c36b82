# SPDX-License-Identifier: Apache-2.0
"""The site's navigation and generated pages; `.ci/run` builds the whole site with warnings as errors."""

import argparse
import re
from pathlib import Path
from types import SimpleNamespace

from docs.tools import site_hooks
from tiscene.cli.parser import parser

DOCS = Path(__file__).parents[2] / "docs"


def test_navigation_is_that_of_the_index():
    config = site_hooks.on_config(SimpleNamespace(nav=None))
    pages = [page for section in config.nav for pages in section.values() for page in pages]
    assert len(pages) == len(set(pages))
    linked = set(re.findall(r"\]\(([^)#]+\.md)\)", (DOCS / "index.md").read_text("utf-8")))
    files = {link for link in linked if not link.startswith("../")}
    assert set(pages) == files | {"index.md", site_hooks.COMMANDS, *site_hooks.BESIDE.values()}


def test_page_of_commands_has_every_command_and_argument():
    page = site_hooks.command_page()
    commands = next(each for each in parser()._actions if isinstance(each, argparse._SubParsersAction)).choices
    for name, command in commands.items():
        start = page.index(f"\n## tiscene {name}\n")
        section = page[start : page.find(f"\n## tiscene {list(commands)[-1]}", start + 5)]
        for argument in command._actions:
            for option in argument.option_strings:
                assert option in ("-h", "--help") or option in section, f"{name} {option}"


def test_links_to_files_beside_docs_lead_to_their_pages():
    page = SimpleNamespace(file=SimpleNamespace(src_uri="dev/notes.md"))
    text = "[a](../../README.md#more) [b](../../CONTRIBUTING.md) [c](../usd.md)"
    expected = "[a](../readme.md#more) [b](../contributing.md) [c](../usd.md)"
    assert site_hooks.on_page_markdown(text, page) == expected
    assert site_hooks._from_root("[a](docs/usd.md) ![b](docs/images/c.webp) [d](CHANGELOG.md)") == (
        "[a](usd.md) ![b](images/c.webp) [d](changelog.md)"
    )

# SPDX-License-Identifier: Apache-2.0
"""Hard use: programs that run tiscene for long, under failures and on extreme input, and print figures.

`python -m tests.stress [ROW[:USE] ...] [--scale S]` prints a table. docs/dev/hard-use.md keeps measured figures.
"""

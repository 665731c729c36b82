# SPDX-License-Identifier: Apache-2.0
"""Programs that check tiscene on a GPU; see `python -m tests.gpu --help`."""

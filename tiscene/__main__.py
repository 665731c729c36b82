# SPDX-License-Identifier: Apache-2.0
"""`python -m tiscene`: the command `tiscene`."""

import sys

from tiscene.cli.main import main

sys.exit(main())

"""`python -m tiscene`."""

import sys

from tiscene.cli import main

sys.exit(main())

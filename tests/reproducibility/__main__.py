# SPDX-License-Identifier: Apache-2.0
"""`python -m tests.reproducibility [--write]`: compare this machine's frames with the digests kept in the repository.

--write: keep this machine's digests instead, after a change that is meant to change pixels.
"""

import json
import sys

from tests.reproducibility.digests import EXPECTED, differences, digests, load


def main() -> int:
    """Run the comparison; return the exit status."""
    found = digests()
    if "--write" in sys.argv[1:]:
        EXPECTED.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    different = differences(load(), found)
    for line in different:
        print(f"different: {line}")
    print(f"{len(different)} of {sum(map(len, found.values()))} buffers differ from the repository's digests")
    return int(bool(different))


if __name__ == "__main__":
    sys.exit(main())

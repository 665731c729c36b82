# SPDX-License-Identifier: Apache-2.0
"""A file of the user's named like one of the packages beside tiscene is named in the error."""

import subprocess
import sys


def test_a_script_beside_its_own_dynamics_module_is_told_which_file_hides_the_package(tmp_path):
    (tmp_path / "dynamics.py").write_text("value = 1\n")
    (tmp_path / "script.py").write_text("import tiscene\n")
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "dynamics.py' hides: rename that file" in done.stderr

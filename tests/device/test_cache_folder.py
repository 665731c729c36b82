# SPDX-License-Identifier: Apache-2.0
"""Without a home, or with a cache folder that cannot be written, tiscene works without a cache."""

import os

import pytest

from tests.device.programs import run_python

RENDER = """
import tiscene as ts
frame = ts.Stream("object_view", width=16, height=12, buffers=("depth",))[0]
print(frame.depth.shape)
"""
KERNEL = """
import tiscene
from tiscene.device import runtime
runtime.start()
from tiscene.device.memory import device_array
import taichi as ti
device_array(ti.f32, 3).copy_from(device_array(ti.f32, 3))  # runs a kernel
print(ti.cfg.offline_cache_file_path)
"""
NO_FOLDER = {"HOME": None, "XDG_CACHE_HOME": None, "TISCENE_CACHE": None, "TI_OFFLINE_CACHE_FILE_PATH": None}


@pytest.mark.parametrize(
    "env",
    [
        {"HOME": "/dev/null/x"},  # below a file, where nobody can create a folder
        pytest.param({"XDG_CACHE_HOME": "/dev/null/x"}, marks=pytest.mark.slow),
        pytest.param(
            {"HOME": "/no/such/home", "XDG_CACHE_HOME": "/dev/null/x", "TISCENE_CACHE": "/dev/null/y"},
            marks=pytest.mark.slow,
        ),
        pytest.param({"TI_OFFLINE_CACHE_FILE_PATH": "/dev/null/x", "HOME": "/dev/null/x"}, marks=pytest.mark.slow),
    ],
)
def test_frame_is_rendered_where_no_cache_can_be_written(env):
    assert run_python(RENDER, env=NO_FOLDER | env, warn="error::UserWarning") == "(12, 16)"


def test_kernels_are_cached_without_home(tmp_path):
    """The folder is that of the user's entry in the password database."""
    code = "import pwd, types; pwd.getpwuid = lambda uid: types.SimpleNamespace(pw_dir=" + repr(str(tmp_path)) + ")"
    folder = run_python(code + KERNEL, env=NO_FOLDER)
    assert folder == str(tmp_path / ".cache/taichi/ticache")
    assert os.listdir(folder)


@pytest.mark.parametrize("existing", [None, *(pytest.param(mode, marks=pytest.mark.slow) for mode in (0o700, 0o777))])
def test_kernels_are_cached_without_home_and_user_entry(existing, tmp_path):
    """As in a container that runs under any user id: a private folder in the temporary one."""
    private = tmp_path / f"tiscene-{os.getuid()}"
    if existing is not None:
        private.mkdir()
        private.chmod(existing)
    code = "import pwd\ndef none(uid): raise KeyError(uid)\npwd.getpwuid = none\n"
    folder = run_python(code + KERNEL, env=NO_FOLDER | {"TMPDIR": str(tmp_path)})
    assert folder.startswith(str(tmp_path / "tiscene-"))
    assert folder.startswith(f"{private}/") == (existing != 0o777), "others could write to it"
    assert (tmp_path / folder).stat().st_uid == os.getuid()


def test_import_sets_no_cache_folder_where_home_is_set():
    code = "import os; before = dict(os.environ); import tiscene; print({*os.environ} - {*before} - {'HOME'})"
    printed = run_python(code, env={"XDG_CACHE_HOME": None, "HOME": "/home"})
    assert "XDG_CACHE_HOME" not in printed

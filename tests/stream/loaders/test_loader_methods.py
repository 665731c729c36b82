# SPDX-License-Identifier: Apache-2.0
"""Libraries are imported when they are used; a missing one is an error that names the extra."""

import subprocess
import sys

import pytest

from tiscene.errors import MissingExtra
from tiscene.stream import loaders
from tiscene.stream.stream import Stream


@pytest.mark.parametrize(
    ("method", "library", "module"),
    [("torch", "torch", "torch_stream"), ("huggingface", "datasets", "hugging_face")],
)
def test_missing_library_names_the_extra(monkeypatch, method, library, module):
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.delitem(sys.modules, f"tiscene.stream.loaders.{module}", raising=False)
    monkeypatch.delattr(loaders, module, raising=False)
    stream = Stream("solid_benchmark", width=8, height=6, frames=2, buffers=("depth",))
    with pytest.raises(MissingExtra, match=rf"pip install 'tiscene\[{method}\]'"):
        getattr(stream, method)()


def test_stream_imports_no_library_for_loading():
    program = (
        "import sys, tiscene; tiscene.Stream; "
        "print(sorted({'torch', 'datasets', 'grain', 'IPython', 'PIL.ImageShow'} & sys.modules.keys()))"
    )
    printed = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert printed == "[]\n"

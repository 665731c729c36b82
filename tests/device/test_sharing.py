# SPDX-License-Identifier: Apache-2.0
"""A process shared with the user's own Taichi code: neither side changes the results of the other."""

import functools

import pytest

from tests.device.programs import run_python

# Uses much of Taichi, and prints every result. The steps depend on each other, as those of a simulation do.
USER_CODE = """
import numpy as np
import taichi as ti

vec3 = ti.types.vector(3, ti.f32)

@ti.func
def swirl(p, k):
    return vec3(ti.sin(p.y + k), ti.cos(p.x), p.z * 0.5) + ti.random() * 0.1

@ti.real_func
def halved(x: ti.f32) -> ti.f32:
    return 0.5 * x

@ti.kernel
def move(positions: ti.types.ndarray(vec3, 1), k: ti.i32) -> ti.f32:
    total = 0.0
    ti.loop_config(serialize=True)
    for i in range(positions.shape[0]):
        positions[i] += halved(swirl(positions[i], k).norm())
        total += positions[i].norm()
    return total

@ti.kernel
def scale(values: ti.types.ndarray(), by: ti.template()):
    for I in ti.grouped(values):
        values[I] *= by

@ti.data_oriented
class Grid:
    def __init__(self, n):
        self.field = ti.field(ti.f64, (n, n), needs_grad=True)
        self.loss = ti.field(ti.f64, (), needs_grad=True)

    @ti.kernel
    def smooth(self, k: ti.i32):
        for i, j in self.field:
            self.field[i, j] = ti.sqrt(i * 1.5 + j + k)

    @ti.kernel
    def reduce(self):
        for i, j in self.field:
            self.loss[None] += self.field[i, j] ** 2

class Program:
    def __init__(self):
        self.positions = ti.ndarray(vec3, 7)
        self.counts = ti.ndarray(ti.i32, (3, 2))
        self.matrices = ti.Matrix.ndarray(2, 2, ti.f32, 4)
        self.grid = Grid(4)
        self.particles = ti.Struct.field({"x": vec3, "alive": ti.i32}, shape=5)

    def step(self, k):
        self.positions.from_numpy(self.positions.to_numpy() + np.float32(0.25 * k))
        print(move(self.positions, k), self.positions.to_numpy().tolist())
        self.counts.fill(k + 2)
        scale(self.counts, 3)
        values = np.arange(4, dtype=np.float64)
        scale(values, 0.5)
        print(self.counts.to_numpy().tolist(), values.tolist())
        self.matrices.fill(1.5)
        scale(self.matrices, 2 + k)
        self.matrices.from_numpy(self.matrices.to_numpy()[::-1])
        print(self.matrices.to_numpy().sum(), self.matrices[1][0, 1])
        self.grid.smooth(k)
        with ti.ad.Tape(self.grid.loss):
            self.grid.reduce()
        print(self.grid.field.to_numpy().sum(), self.grid.field.grad.to_numpy().sum(), self.grid.loss[None])
        self.particles.alive.fill(k)
        print(self.particles.to_numpy()["alive"].tolist())
        for wrong in (lambda: self.counts.from_numpy(values), lambda: move(self.counts, 1), lambda: broken()):
            try:
                wrong()
            except Exception as error:
                lines = [line for line in str(error).splitlines() if 'File "' not in line]
                print(type(error).__name__, *lines, sep="|")

@ti.kernel
def broken():
    x = no_such_name + 1

def start(**options):
    ti.init(arch=ti.cpu, fast_math=False, cpu_max_num_threads=1, random_seed=3, log_level=ti.ERROR, **options)
"""
STREAM = """
stream = ts.Stream("object_view", width=32, height=24, quality="fast")
def digest(k):
    import hashlib
    frame = stream[k]
    return "stream " + hashlib.sha256(b"".join(frame[name].tobytes() for name in frame.keys())).hexdigest()
"""
ALONE = USER_CODE + "start()\nprogram = Program()\nfor k in range(3):\n    program.step(k)\n"
SHARED = (
    USER_CODE
    + """
start()
program = Program()
program.step(0)
import tiscene as ts
"""
    + STREAM
    + """
print(digest(0))
program.step(1)
print(digest(1))
del stream
program.step(2)
"""
)
STREAM_FIRST = (
    "import tiscene as ts\n" + STREAM + "print(digest(0))\n" + USER_CODE + "program = Program()\nprogram.step(0)\n"
    "print(digest(1))\nprogram.step(1)\nprogram.step(2)\n"
)
STREAM_ALONE = "import tiscene as ts\n" + STREAM + "print(digest(0))\nprint(digest(1))\n"


def split(printed: str) -> tuple[list[str], list[str]]:
    """Return what the user's code and what the stream printed."""
    lines = [line for line in printed.splitlines() if not line.startswith("[Taichi]")]
    return [line for line in lines if line[:6] != "stream"], [line for line in lines if line[:6] == "stream"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run a program once, from a file, since Taichi reads the sources of kernels."""

    @functools.cache
    def run(code, **env):
        file = tmp_path_factory.mktemp("shared") / "program.py"
        file.write_text(code)
        return split(
            run_python(str(file), env={**env, "ENABLE_TAICHI_HEADER_PRINT": "0", "TI_SKIP_VERSION_CHECK": "ON"})
        )

    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        "advanced_optimization=False",  # as in this project, so that compiled kernels are found in the cache
        "",
    ],
)
def test_user_code_and_stream_give_the_same_as_alone(run, options):
    alone, shared = (code.replace("start()", f"start({options})") for code in (ALONE, SHARED))
    user, stream = run(alone)[0], run(STREAM_ALONE)[1]
    assert len(user) == 3 * 8
    assert run(shared) == (user, stream)


@pytest.mark.slow
def test_user_code_runs_after_the_stream_started_taichi(run):
    started = "from tiscene.device import runtime\nruntime.start()\n"
    alone = started + USER_CODE + "program = Program()\nfor k in range(3):\n    program.step(k)\n"
    deterministic = [code.replace("ti.random()", "0.5") for code in (alone, STREAM_FIRST)]
    user, (shared, stream) = run(deterministic[0], TISCENE_TAICHI_PATCHES="0")[0], run(deterministic[1])
    assert shared == user
    assert stream == run(STREAM_ALONE)[1]


@pytest.mark.slow
def test_stream_without_patches_has_the_same_digests(run):
    """Buffers of the first frames, in color and with labels."""
    assert run(STREAM_ALONE, TISCENE_TAICHI_PATCHES="0") == run(STREAM_ALONE)


def test_classes_of_taichi_are_as_they_were_after_a_stream(run):
    code = """
import taichi as ti
from taichi._lib import core
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
owners = (kernel_impl, kernel_impl.Kernel, kernel_impl.Func, ASTTransformerContext, core, core.ASTBuilder, core.Expr,
          core.Kernel, core.TypeFactory)
before = [dict(vars(owner)) for owner in owners]
@ti.kernel
def early() -> ti.i32:
    return 3
import tiscene as ts
from tiscene.device.taichi_patches.patched_kernel import PatchedKernel
import dynamics.step_kernel
stream = ts.Stream("object_view", width=8, height=8, buffers=("depth",))
stream[0]
@ti.kernel
def late() -> ti.i32:
    return 4
print(early(), late())
changed = {f"{owner.__name__}.{name}" for owner, names in zip(owners, before, strict=True)
           for name, value in vars(owner).items() if names.get(name) is not value and type(value) is not int}
print(sorted(changed))
print(type(early._primal) is type(late._primal) is kernel_impl.Kernel)
kernels = [k for k in kernel_impl.impl.get_runtime().kernels if isinstance(k, kernel_impl.Kernel)]
print({type(k) for k in kernels if k.func.__module__.startswith(("tiscene", "dynamics"))
       and k.autodiff_mode == kernel_impl.AutodiffMode.NONE} == {PatchedKernel})
"""
    assert run(code)[0] == [
        "3 4",
        "['taichi.lang.kernel_impl._inside_class', 'taichi.lang.kernel_impl._kernel_impl']",
        "True",
        "True",
    ]


def test_other_version_of_taichi_runs_without_patches_and_warns_once():
    code = """
import warnings
import taichi as ti
ti.__version__ = (1, 7, 5)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from tiscene.device import runtime
    runtime.start()
    import tiscene.scene.bvh.build_kernels as kernels
    from tiscene.device.taichi_patches import fence
    print(fence.enabled(), type(kernels.grow._primal) is ti.lang.kernel_impl.Kernel)
print([str(each.message) for each in caught if "Taichi 1.7.5" in str(each.message)])
"""
    enabled, warning = run_python(code).splitlines()
    assert enabled == "False True"
    assert warning.count("is installed, but") == 1
    assert "install taichi==1.7.4" in warning


RESTARTED = """
import gc
import taichi as ti
import tiscene as ts
stream = ts.Stream("object_view", width=16, height=12, buffers=("depth",))
first = stream[0].depth
visitor = ts.Stream("solid_benchmark", width=16, height=12, buffers=("depth",))
visitor[0]
visitor.restart(ts.Scenario("object_view"))  # the trees of the other scene are kept
visitor[0]
{restart}
mine = [ti.ndarray(ti.f32, 100) for _ in range(300)]
for k, array in enumerate(mine):
    array.fill(float(k))
for use in (lambda: stream[0], lambda: stream[1], lambda: next(stream), lambda: stream.render_view(0, None)):
    try:
        use()
    except ts.TisceneError as error:
        print(type(error).__name__, error)
fresh = ts.Stream("object_view", width=16, height=12, buffers=("depth",))
print((fresh[0].depth == first).all())
visitor.restart(ts.Scenario("object_view"))
print((visitor[0].depth == first).all())
visitor.restart(ts.Scenario("solid_benchmark"))
visitor[0]
del stream
gc.collect()
more = [ti.ndarray(ti.f32, 100) for _ in range(300)]
for array in more:
    array.fill(-1.0)
print(all((array.to_numpy() == k).all() for k, array in enumerate(mine)))
print((fresh[0].depth == first).all())
"""


@pytest.mark.parametrize("switch", [pytest.param("0", marks=pytest.mark.slow), "1"])
def test_stream_after_a_restart_of_taichi_raises_and_a_new_one_works(switch):
    restart = "ti.init(arch=ti.cpu, fast_math=False, advanced_optimization=False, log_level=ti.ERROR)"
    printed = run_python(RESTARTED.format(restart=restart), env={"TISCENE_TAICHI_PATCHES": switch}).splitlines()
    lines = [line for line in printed if not line.startswith("[Taichi]")]
    assert lines[4:] == ["True"] * 4
    for line in lines[:4]:
        assert line.startswith("DeviceError Taichi was restarted in this process, by ti.init() or ti.reset()")
        assert "Call ti.init(fast_math=False, ...) before the first Stream" in line

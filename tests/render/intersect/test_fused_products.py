# SPDX-License-Identifier: Apache-2.0
"""Products of the two-wide traversal cannot be fused with sums, and edge functions are antisymmetric.

LLVM fuses a product into the sum that uses it, where the target allows it, as CUDA does. The traversal's optimized code
is read: no difference may use a product directly.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import taichi as ti
import trimesh

from tests.render.tracing import placed, random_rays, scene_of, shape, trace_rays
from tiscene.device.kernel_types import Floats1, Floats2, Ints1
from tiscene.render.intersect.bvh2 import UNUSED, edge_function

ROOT = Path(__file__).parents[3]


@ti.kernel
def edge_functions(edges: Floats2, zero: Ints1, naive: Floats1, rounded: Floats1):
    """Write the functions of edges: as a plain difference of products, and as the traversal computes it."""
    for i in range(edges.shape[0]):
        px, py, qx, qy = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        naive[i] = px * qy - py * qx
        rounded[i] = edge_function(px, py, qx, qy, zero[0])


def count_asymmetries() -> list[int]:
    """Count edges whose function differs from the negative of the reversed edge's: naive, as the traversal does."""
    edges = np.random.default_rng(3).uniform(-1.0, 1.0, (100_000, 4)).astype(np.float32)
    edges[:, 2:] = edges[:, :2] * np.float32(1.0 + 1e-6)  # lines through the origin, where signs are decided
    found = np.zeros((2, 2, len(edges)), np.float32)
    for order, values in zip((edges, np.ascontiguousarray(edges[:, [2, 3, 0, 1]])), found, strict=True):
        edge_functions(order, np.zeros(1, np.int32), *values)
    return (found[0] != -found[1]).sum(axis=1).tolist()


def fusible_differences(code: str) -> tuple[int, int]:
    """Return the number of differences in LLVM code, and of those that use a product directly.

    For some processors differences are computed by twos, in vectors. What is picked from a product is a product too.
    """
    count = fusible = 0
    for function in code.split("\ndefine ")[1:]:  # each has names of its own
        products = set(re.findall(r"(%[\w.]+) = fmul ", function))
        for name, operands in re.findall(r"(%[\w.]+) = (?:shufflevector|\w+element) (.+)", function):
            if not products.isdisjoint(re.findall(r"%[\w.]+", operands)):
                products.add(name)
        for lanes, *operands in re.findall(r"= fsub [\w ]*(?:<(\d+) x )?float>? (\S+), (\S+)", function):
            count += int(lanes or 1)
            fusible += int(lanes or 1) * (not products.isdisjoint(operands))
    return count, fusible


def test_compiler_sees_no_product_in_a_difference_of_the_traversal(tmp_path: Path) -> None:
    program = (
        "import numpy as np, taichi as ti\n"
        "ti.init(arch=ti.cpu, fast_math=False, offline_cache=False, log_level=ti.ERROR,\n"
        "        print_kernel_llvm_ir_optimized=True)\n"
        "from tests.render.intersect.test_fused_products import count_asymmetries\n"
        "from tiscene.device.memory import device_array\n"
        "from tiscene.render.intersect import bvh2\n"
        "from tiscene.render.intersect.ray_queue import hit, hit_id, ray\n"
        "count_asymmetries()\n"
        "f, i = (lambda *shape: device_array(ti.f32, shape)), (lambda *shape: device_array(ti.i32, shape))\n"
        "bvh2.closest(f(2, 16), f(1, 12), f(3, 1, 12), i(1, 17), 1, 0, device_array(ray, 1), i(1), 0, i(1), 0,\n"
        "             device_array(hit, 1), device_array(hit_id, 1))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TISCENE_TAICHI_PATCHES": "0"}
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, check=True, timeout=300)
    found = {}
    for file in tmp_path.glob("*optimized*.ll"):
        code = file.read_text()
        found |= {name: fusible_differences(code) for name in ("edge_functions", "closest") if f"@{name}_c" in code}
    differences, fusible = found["edge_functions"]
    assert fusible > 0  # the plain one
    assert fusible < differences
    differences, fusible = found["closest"]
    assert differences >= 12
    assert fusible == 0


def test_reversed_edges_have_opposite_functions_without_fusing() -> None:
    assert count_asymmetries() == [0, 0]


def test_unused_column_of_triangles_is_zero() -> None:
    """Its bits are part of every product: anything else would change hits."""
    scene = scene_of((shape(trimesh.creation.icosphere(subdivisions=2)),), placed([0]), "bvh2")
    assert (trace_rays(scene, random_rays(np.random.default_rng(1), 100, 2.0)).instance >= 0).any()
    assert not scene.leaf_blocks.to_numpy()[:, UNUSED].any()

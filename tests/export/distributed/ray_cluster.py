# SPDX-License-Identifier: Apache-2.0
"""A Ray cluster of several nodes on this machine, and exports on it; run in a process of its own by the tests.

`python -m tests.export.distributed.ray_cluster KIND FOLDER NODES KILL` prints JSON: which faults were done.
"""

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import tiscene as ts
from tests.export.generation.test_recipe import RECIPE
from tests.stress.process_resources import resident_memory
from tiscene.export.generation.recipe import Recipe

FRAMES = 600
SETTINGS = {"width": 32, "height": 24, "buffers": ("instance", "depth", "forward_flow")}
COUNT = 96


def recipe() -> Recipe:
    return Recipe.from_json(RECIPE | {"scenes": ["object_view", "solid_benchmark"]})


def workers(node) -> list[int]:
    """Return the processes of actors on a node, which are children of its raylet."""
    raylet = next(iter(node.all_processes["raylet"])).process.pid
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, parent = stat.read_text().rpartition(")")[0], int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if parent == raylet and "RayWorker" in name + (stat.parent / "cmdline").read_text():
            found.append(int(stat.parent.name))
    return found


def main() -> None:
    kind, folder, kill = sys.argv[1], Path(sys.argv[2]), sys.argv[4] == "kill"
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [cluster.add_node(num_cpus=1) for _ in range(int(sys.argv[3]))]
    faults: list[str] = []
    counts: list[int] = []
    peak = 0

    def fault() -> None:
        nonlocal peak
        while not counts or counts[-1] < 2:
            time.sleep(0.05)
        while True:
            pids = [pid for node in nodes if node in cluster.worker_nodes for pid in workers(node)]
            for pid in pids:
                try:
                    peak = max(peak, resident_memory(pid))
                except OSError:
                    continue
            if kill and not faults and counts[-1] >= total // 6:
                pid = workers(nodes[0])[0]
                os.kill(pid, signal.SIGKILL)
                faults.append(f"killed {pid}")
            if kill and len(faults) == 1 and counts[-1] >= total // 3:
                cluster.remove_node(nodes[1], allow_graceful=False)
                faults.append("removed a node")
            time.sleep(0.1)

    threading.Thread(target=fault, daemon=True).start()
    options = {"address": cluster.address, "progress": counts.append}
    if kind == "render":
        total = FRAMES
        options |= {"frames": range(FRAMES), "format": "webdataset"}
        ts.distributed.render("solid_benchmark", folder, **options, **SETTINGS)
    else:
        total = COUNT
        ts.distributed.generate(recipe(), folder, COUNT, **options)
    print(json.dumps({"faults": faults, "peak": peak, "last": counts[-1]}))
    cluster.shutdown()


if __name__ == "__main__":
    main()

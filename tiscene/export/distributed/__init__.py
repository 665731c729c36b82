# SPDX-License-Identifier: Apache-2.0
"""One export or data set by several processes or machines, with the bytes of one: `ts.distributed`.

`render` and `generate` run on a Ray cluster (`pip install 'tiscene[ray]'`).

::

    cluster_runs      render, generate: on a Ray cluster
    worker_processes  processes on this machine, one per shard
    frame_work, scenario_work  what the tasks of an export and of a data set do
    task_plan         which task each worker does next
    task_loop         keeps workers busy until all tasks are done
    ray_pool          workers on the nodes of a Ray cluster
    ray_worker        the actor on a node
"""

from __future__ import annotations

from dynamics.lazy_names import lazy_names

_MODULES = {"tiscene.export.distributed.cluster_runs": ("generate", "render")}
__getattr__, __dir__, __all__ = lazy_names(__name__, _MODULES)

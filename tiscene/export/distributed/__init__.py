# SPDX-License-Identifier: Apache-2.0
"""One export by several processes or machines, with the bytes of one.

::

    worker_processes  processes on this machine, one per shard
"""

# SPDX-License-Identifier: Apache-2.0
"""Replacements for slow parts of Taichi 1.7.4's Python code, for the kernels of this project alone.

A launch takes 0.06 ms instead of 0.2 to 0.3 ms, and the first frame half the time. Kernels, functions and arrays of
other packages in the process run on Taichi's own code. ``TISCENE_TAICHI_PATCHES=0`` in the environment turns all
patches off, and any other version of Taichi does so with a warning; the results are the same, byte for byte.

::

    fence             which packages are patched; the switch and the version check
    patched_kernel    PatchedKernel, the class of this project's kernels
    launch            launch a compiled kernel with less Python
    frontend          parse each function once while kernels compile
    ast_recorder      record AST builder calls and replay them in later processes
    recorded_calls    the calls that are recorded
    simplified_calls  leave out calls that the compiler would have to undo
    recording_file    recorded calls as files
    fingerprint       identify a kernel by everything its source depends on
    memcpy            copy arrays without kernels
    cuda_memory       copies to and from a CUDA card by its driver
    tracebacks        make arrays without the text of the call stack
"""

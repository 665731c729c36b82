# SPDX-License-Identifier: Apache-2.0
"""Replacements for slow parts of Taichi 1.7.4's Python front end.

::

    frontend        parse each function once
    ast_recorder    record AST builder calls and replay them in later processes
    recording_file  recorded calls as files
    fingerprint     identify a kernel by everything its source depends on
    launch          launch kernels with less Python
    memcpy          copy arrays without kernels
"""

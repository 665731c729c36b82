# SPDX-License-Identifier: Apache-2.0
"""The command line `tiscene`: one module per command.

A command is a module with `run(args)`; its arguments are in `parser`.

::

    main      entry point, errors, interrupts
    parser    arguments of all commands
    terminal  progress bars and notes on stderr
    demo, render, list, show, inspect, import, bench, serve, sailenv  the commands
"""

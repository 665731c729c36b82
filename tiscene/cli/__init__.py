# SPDX-License-Identifier: Apache-2.0
"""The command line: one module per command.

::

    main      entry point, errors, interrupts
    parser    arguments of all commands
    terminal  progress bars and messages on stderr
    demo, render, list, show, inspect, import, bench, serve  the commands
"""

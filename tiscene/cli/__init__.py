# SPDX-License-Identifier: Apache-2.0
"""The command line `tiscene`: one module per command.

A command is a module with `run(args)`; its arguments are in `parser`.

::

    main      entry point, errors
    interruption  Ctrl-C ends a command in time
    parser    arguments of all commands
    argument_types  types of arguments
    terminal  progress bars and notes on stderr
    common_arguments  arguments that several commands have
    render_arguments, data_set_arguments  arguments of render; of verify, merge, sample and generate
    join_arguments  arguments of join
    stream_arguments  frames and streams from arguments
    demo, render, verify, merge, sample, generate, preview, view, list, show, inspect, import, bench  the commands
    join, measure, evaluate, serve, sailenv  more commands
"""

"""Helpers of several commands: exit codes, options, requests, and the graph of running programs.

Start with `command`, which runs every command and prints its errors. `parsing` and `remote` define
the options, `values` reads requests, `calling` makes calls, `graph` finds running programs. No
command is defined here, and nothing here imports one.
"""

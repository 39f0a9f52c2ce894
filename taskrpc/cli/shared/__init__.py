"""Helpers of several commands: exit codes, options, requests, and the graph of running programs.

Start with `command`, which runs every command and prints its errors. `parsing` and `remote` have
the options, `values` reads requests, `graph` looks for programs. No command is defined here.
"""

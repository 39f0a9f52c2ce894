"""SQLite files that keep data after the process has ended: one file for each store.

Start with `writer`, which collects changes into transactions, then `database`, which carries them
out. `path_checks` and `lock` refuse a file that is not safe to use. Nothing here knows the contents
of a store: the tables belong to `taskrpc.core.exactly_once` and `taskrpc.robot.tasks.records`.
"""

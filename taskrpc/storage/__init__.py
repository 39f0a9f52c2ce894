"""SQLite files in which data survives the process: one file a store, used by one process.

Start with `writer`, which collects changes into transactions, then `database`, which carries them
out; `path_checks` and `lock` refuse a file that is not safe to use. Nothing here knows what a store
keeps: the tables belong to `taskrpc.exactly_once` and `taskrpc.tasks.records`.
"""

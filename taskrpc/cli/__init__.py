"""The command lines `taskrpc`, `taskrpc-call` and `taskrpc-server`.

Each verb of `taskrpc` has a module or a folder of its name. Start with `main`, which chooses the
verb; `shared` has what several verbs need. A module of the library never imports from here, and
what a program can use without a command line belongs to the library.
"""

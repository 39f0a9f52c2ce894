"""The command lines `taskrpc`, `taskrpc-call` and `taskrpc-server`.

Each verb of `taskrpc` has a module or a folder of its name. Start with `main`, which chooses the
verb; `shared` contains the helpers of several verbs. The library never imports from here. Code that
a program can use without a command line belongs to the library.
"""

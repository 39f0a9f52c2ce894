"""Which programs run on this machine, and what each of them offers.

Start with `registry`, which keeps a file for each process. `entries` is the content of such a
file, `journal` its format, and `availability` wakes clients that wait for a service. Nothing here
connects to another process.
"""

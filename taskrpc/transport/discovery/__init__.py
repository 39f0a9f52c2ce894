"""Which programs run on this machine, and what each of them offers.

Start with `registry`, which keeps a file for each process; `entries` is what a process writes
there, and `availability` wakes clients that wait for a service."""

"""A submission in child processes, with limits.

    the command ── worker: the checks ── box ═ bubblewrap ═ supervisor ── child: a program

`worker` grades one submission in a process of its own, over a `child_trial`. `box` starts a sandbox
with the command line of `bubblewrap`; in it, `supervisor` starts the programs by forking itself.
Each program begins in `child`, which sets the `limits`. `speed` is accelerated time in worker and
programs. Checks of waits and orders run a program in virtual time instead: see `simulated`.

The checks run outside, where a submission cannot reach them except through its services and its
output. They open no file that a program can change: registry and sockets of the sandbox come
through the supervisor, over a `network` of their own. So a submission can pass only by behaving as
the checks expect; `simulated` says what it can make up. Without bubblewrap, the same processes run
without a sandbox.
"""

"""A submission in child processes, with limits.

    the command ── worker: the checks ── fork_server ── child: a program of the submission

`worker` grades one submission in a process of its own, over a `child_trial`. The programs start
in `child`, which sets their limits: `limits`, `linux` and `guard`. `speed` is accelerated time in
worker and programs. The checks run where a submission cannot reach except through its services and
its output. So a submission can pass only by behaving as the checks expect.
"""

"""A program of a submission in virtual time, inside the sandbox.

`process` plays one run of `taskrpc.simulation` in a process of its own: the submission's program,
and `companion`, which has the service and the calls of the checks. The checks stay outside. They
answer each request, and judge what the process reports; `messages` lists what both sides send.
The clock jumps from event to event, so a busy machine changes no time that a check sees.

The process itself says what time it is, and what came of the calls of the checks. A submission
that attacks the simulation can make these up; other checks of each lab run it in real time.
"""

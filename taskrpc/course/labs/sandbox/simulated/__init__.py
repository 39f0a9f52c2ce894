"""A program of a submission in simulated time, inside the sandbox.

`process` plays one run of `taskrpc.simulation` in a process of its own: the submission's program,
and `companion`, which has the service and the calls of the checks. The checks stay outside. They
answer each request, and judge what the process reports; `messages` lists what both sides send.
The clock jumps from event to event, so a busy machine changes no time that a check sees.

The process itself says what time it is. A submission that changes the simulation could therefore
wait without waiting, but it still has to send the requests and print the responses.
"""

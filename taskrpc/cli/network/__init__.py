"""Verbs for the processes of this machine, and for doors to other networks.

`ps` lists processes and `stop` ends them; start with `ps`, which is short. `bridge` and `router`
run until they are interrupted, and connect programs of other protocols. `door` checks the policy
that says what such programs may do. `taskrpc doctor`, which examines connections, is in `ros`,
because `ros2` has this verb.
"""

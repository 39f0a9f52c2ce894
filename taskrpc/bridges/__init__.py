"""Doors for programs that do not use taskrpc.

`rosbridge` connects browsers and other clients of rosbridge v2, `mcp` connects agents, and
`gateway` passes the services of a robot on to the laptops of a lab. `door` has the policy: what
such programs may do. What a bridge lets through is decided in pure modules. The transports, which
carry calls between programs that do use taskrpc, are not here.
"""

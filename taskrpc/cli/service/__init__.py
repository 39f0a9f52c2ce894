"""`taskrpc service` and `taskrpc-call`: call, echo, find, info, list and type.

Start with `command_line`; `calling` makes the calls."""

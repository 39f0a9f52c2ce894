"""`taskrpc topic`: list, info, type, find, echo, pub, hz, bw and delay.

Start with `command_line`; each verb has a module."""

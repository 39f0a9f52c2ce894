"""The `srvgen` command: generate, check, fix, describe, show, hash and stubs.

Start with `main`; `commands` has a function for each command. `process` (signals, broken output)
is shared with the commands of taskrpc. No rule of the definition language belongs here."""

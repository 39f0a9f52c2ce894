"""The `srvgen` command: generate, check, fix, describe, show, hash and stubs.

Start with `main`; `commands` has a function for each command. No rule of the definition language
is decided here."""

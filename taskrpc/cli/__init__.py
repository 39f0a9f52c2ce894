"""The command lines: `taskrpc`, `taskrpc-call` and `taskrpc-server`."""

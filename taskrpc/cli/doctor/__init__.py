"""`taskrpc doctor`: finds out why something does not work.

Start with `command_line`; `checks` looks at this machine, `probe` at an address."""

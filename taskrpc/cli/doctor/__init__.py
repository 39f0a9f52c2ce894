"""`taskrpc doctor`: find out why a program does not reach another.

Start with `command_line`; `checks` looks at this machine, `probe` tries an address step by step,
and `encryption` compares certificates. The doctor only reports: it changes nothing.
"""

"""`taskrpc doctor`: find out why a program does not reach another.

Start with `command_line`. `checks` examines this machine, `probe` tries an address step by step,
`encryption` checks certificates, `middlewares` checks Zenoh and ROS 2. The doctor only reports and
changes nothing.
"""

"""`taskrpc classroom`: lets the laptops of a class call this machine's robot.

Start with `command_line`; `roster` lists the students."""

"""`taskrpc classroom`: let the laptops of a class call the robot of this machine.

Start with `command_line`; `roster` lists the students. Certificates, accounts and join strings
are made in `taskrpc.classroom`, not here.
"""

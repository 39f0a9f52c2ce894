"""`taskrpc classroom`: let the laptops of a class call the robot of this machine.

Start with `command_line`. `roster` lists the students, and `live_class` shows them on the live
page. `taskrpc.course.classroom` makes certificates, accounts and join strings.
"""

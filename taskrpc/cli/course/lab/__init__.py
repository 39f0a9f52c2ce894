"""`taskrpc lab`: starts a lab in the current folder, and checks submissions.

Start with `command_line`. The labs and their checks are in `taskrpc.course.labs`.
"""

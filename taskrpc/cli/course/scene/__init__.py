"""`taskrpc scene`: shows a scene of a lecture in the terminal or on a page.

Start with `command_line`. `screen` lays out what a projector shows, as plain or coloured lines. The
scenes themselves, and the player that runs their programs, are in `taskrpc.course.scenes`.
"""

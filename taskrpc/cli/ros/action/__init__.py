"""`taskrpc action`: list actions, send goals and watch them.

Start with `command_line`. Each command that is longer than a few lines has a module of its own.
Nothing here runs an action server.
"""

"""Verbs that show running programs to people: in the terminal and in the browser.

Start with `view.command_line`. What the verbs show comes from `taskrpc.observe`.
Nothing here changes a program, and verbs that `ros2` has too, such as `bag`, are in `ros`.
"""

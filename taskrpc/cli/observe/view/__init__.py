"""`taskrpc view`: opens the live page, a recording or the labs in the browser.

Start with `command_line`, which finds the page or starts its server. `recording` serves a
recording. The pages themselves are in `taskrpc.observe.web`.
"""

"""Recordings: MCAP files of topics, service calls and the task server's decisions.

Start with `mcap_file`, which writes and reads a file; `sqlite_file` reads bags of older versions of
ROS 2. `recorder` and `run_recorder` fill files, `player` publishes them again, and `replay`,
`timeline` and `sequence` read the recorded run of a task server. Nothing here prints: the
commands are in `taskrpc.cli.ros.bag`. Needs the extra `record`.
"""

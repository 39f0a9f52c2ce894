"""Recordings: MCAP files of topics, service calls and the task server's decisions.

Start with `mcap_file`, which writes and reads a file. `recorder` and `run_recorder` fill files,
`player` publishes them again, and `replay`, `timeline` and `sequence` read the recorded run of a
task server. Nothing here prints: the commands are in `taskrpc.cli.bag`. Needs the extra `record`.
"""

"""What people and monitors see of running programs.

`web` serves the live page, `recording` writes and replays MCAP files, `metrics` counts for
Prometheus, and `otel` reports spans to OpenTelemetry. All of them watch: they receive events of the
core and of the robot, and neither may depend on them.
"""

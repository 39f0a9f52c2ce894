"""Tests of `taskrpc simulate`; `task_server` is a scenario of the whole task server with faults."""

"""Warnings about mistakes that ROS 2 does not report, such as deadlocks and unspun nodes.

Start with `explain`, which has all texts; `deadlocks` checks before a callback waits, and
`watchdog` looks at all nodes once a second. These modules only read; they use the public methods
of entities, executors and nodes.
"""

"""Which callback runs when, and on which thread.

Start with `entity`, which defines what callbacks come from, then `scheduler`, which every executor
derives from. The executor classes that programs see are in `rclpy.executors`.
"""

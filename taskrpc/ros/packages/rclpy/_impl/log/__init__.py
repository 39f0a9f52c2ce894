"""The log: what a line looks like, which lines pass, and where they go.

Start with `output`, which every logger calls; `filters` and `format` serve it, and `rosout`
publishes lines through a node. The logger classes that programs see are in `rclpy.impl`.
"""

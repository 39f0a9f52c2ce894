"""The gateway of a lab: laptops without ROS call the robot's services over TCP.

Start with `gateway`. The other modules are pure: `allowed` says which names laptops may use,
`account_limits` how many calls of one account reach the robot, and `robot_topics` with which
quality of service the gateway subscribes and publishes.
"""

from taskrpc.bridges.gateway.account_limits import AccountLimits
from taskrpc.bridges.gateway.allowed import Allowed
from taskrpc.bridges.gateway.gateway import Gateway

__all__ = ["AccountLimits", "Allowed", "Gateway"]

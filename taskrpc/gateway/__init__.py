"""The gateway of a lab: laptops without ROS call the robot's services over TCP.

Start with `gateway`. `allowed` and `account_limits` are pure: which names laptops may use, and how
many calls of one account reach the robot.
"""

from taskrpc.gateway.account_limits import AccountLimits
from taskrpc.gateway.allowed import Allowed
from taskrpc.gateway.gateway import Gateway

__all__ = ["AccountLimits", "Allowed", "Gateway"]

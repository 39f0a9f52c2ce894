"""The classes of rclpy.action, so that programs that import them start.

taskrpc has no actions yet: a new client or server prints this, and names the alternative. Start
with `client`, which has the message. No implementation of actions belongs here.
"""

from .client import ActionClient
from .server import ActionServer, CancelResponse, GoalResponse

__all__ = ["ActionClient", "ActionServer", "CancelResponse", "GoalResponse"]

"""What rclpy calls experimental: AsyncNode, the node of asyncio, and the events executor.

Start with `async_node`; the other `async_` modules have the parts of such a node. Only names of
ROS's package belong here.
"""

from .async_client import AsyncClient
from .async_clock import AsyncClock
from .async_node import AsyncNode
from .async_publisher import AsyncPublisher
from .async_service import AsyncService
from .async_subscription import AsyncSubscription
from .async_timer import AsyncTimer
from .events_executor import EventsExecutor

__all__ = [
    "AsyncClient",
    "AsyncClock",
    "AsyncNode",
    "AsyncPublisher",
    "AsyncService",
    "AsyncSubscription",
    "AsyncTimer",
    "EventsExecutor",
]

"""Publishers that are silent until their node is active."""

from __future__ import annotations

from typing import Any

from ..publisher import Publisher
from .managed_entity import SimpleManagedEntity


class LifecyclePublisher(SimpleManagedEntity, Publisher[Any]):
    """Publishes while its node is active; `LifecycleNode.create_lifecycle_publisher` makes one."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        SimpleManagedEntity.__init__(self)
        Publisher.__init__(self, *args, **settings)

    @SimpleManagedEntity.when_enabled
    def publish(self, msg: Any) -> None:
        """Send a message as any publisher does; nothing happens while the node is not active."""
        Publisher.publish(self, msg)

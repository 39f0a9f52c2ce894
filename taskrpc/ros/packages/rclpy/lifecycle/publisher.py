"""Publishers that publish only while their node is active."""

from __future__ import annotations

from typing import Any

from ..publisher import Publisher
from .managed_entity import SimpleManagedEntity


class LifecyclePublisher(SimpleManagedEntity, Publisher[Any]):
    """Publishes while its node is active; `LifecycleNode.create_lifecycle_publisher` creates it."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        SimpleManagedEntity.__init__(self)
        Publisher.__init__(self, *args, **settings)

    @SimpleManagedEntity.when_enabled
    def publish(self, msg: Any) -> None:
        """Publish a message; does nothing while the node is not active."""
        Publisher.publish(self, msg)

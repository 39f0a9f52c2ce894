"""Nodes whose work is set up, begun, ended and cleaned up step by step, on request of others."""

from .._impl.lifecycle_states import LifecycleState
from .._impl.lifecycle_states import TransitionCallbackReturnType as TransitionCallbackReturn
from .managed_entity import ManagedEntity, SimpleManagedEntity
from .node import LifecycleNode, LifecycleNodeMixin
from .publisher import LifecyclePublisher

Node = LifecycleNode
NodeMixin = LifecycleNodeMixin
State = LifecycleState
Publisher = LifecyclePublisher

__all__ = [
    "LifecycleNode",
    "LifecycleNodeMixin",
    "LifecyclePublisher",
    "LifecycleState",
    "ManagedEntity",
    "SimpleManagedEntity",
    "TransitionCallbackReturn",
]

"""Lifecycle nodes, which other programs configure, activate, deactivate and clean up.

Start with `node`; `managed_entity` and `publisher` are objects with callbacks in transitions. The
table of states and transitions is in `_impl.lifecycle_states`.
"""

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

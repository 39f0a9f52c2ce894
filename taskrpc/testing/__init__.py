"""Tools for testing programs that use taskrpc: connected nodes, a clock that jumps, a network that
fails.
"""

from taskrpc.testing.clock import NothingWillEverHappen, VirtualTimeLoop
from taskrpc.testing.network import FaultyNetwork
from taskrpc.testing.nodes import connected_nodes

__all__ = ["FaultyNetwork", "NothingWillEverHappen", "VirtualTimeLoop", "connected_nodes"]

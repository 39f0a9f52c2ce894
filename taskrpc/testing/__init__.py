"""Tools for testing programs that use taskrpc: a clock that jumps, a network that fails."""

from taskrpc.testing.clock import NothingWillEverHappen, VirtualTimeLoop
from taskrpc.testing.network import FaultyNetwork

__all__ = ["FaultyNetwork", "NothingWillEverHappen", "VirtualTimeLoop"]

"""Tools for tests of programs that use taskrpc: connected nodes, virtual time, a faulty network.

Start reading with `clock`, the event loop in virtual time, and `network`, the nodes and the faults;
`faulty_connections` carries the faults out. The other packages never use it.
"""

from taskrpc.testing.clock import NothingWillEverHappen, VirtualTimeLoop
from taskrpc.testing.network import FaultyNetwork, connected_nodes

__all__ = ["FaultyNetwork", "NothingWillEverHappen", "VirtualTimeLoop", "connected_nodes"]

"""Tools for tests of programs that use taskrpc: connected nodes, virtual time, and faults.

Start reading with `clock`, the event loop in virtual time, and `network`, the nodes and the faults
of connections; `faulty_connections` carries these out. `call_faults` injects faults into single
calls, as `fault_specs` decides. Of the other packages, only `taskrpc-server --fault` uses it.
"""

from taskrpc.testing.call_faults import CallFaults
from taskrpc.testing.clock import NothingWillEverHappen, VirtualTimeLoop
from taskrpc.testing.network import FaultyNetwork, connected_nodes

__all__ = [
    "CallFaults",
    "FaultyNetwork",
    "NothingWillEverHappen",
    "VirtualTimeLoop",
    "connected_nodes",
]

"""A fleet: several servers, each with its robot, share one durable queue in one database.

Start reading with `plan` and `rules`: pure functions that decide which robot executes which task,
and what a transaction may change. `state` is a server's copy of the database; `store` is the
interface to the database, `postgres` the real one. `manager` has every operation on tasks,
`lease` and `worker` drive the robot, and `server` offers all of it to the network.
"""

from taskrpc.robot.fleet.manager import FleetManager, FleetSettings
from taskrpc.robot.fleet.server import FleetServer
from taskrpc.robot.fleet.store import FleetStore, MemoryFleet, MemoryFleetStore

__all__ = [
    "FleetManager",
    "FleetServer",
    "FleetSettings",
    "FleetStore",
    "MemoryFleet",
    "MemoryFleetStore",
]

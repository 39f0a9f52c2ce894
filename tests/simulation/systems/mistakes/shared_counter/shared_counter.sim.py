"""Callbacks of a reentrant group share a counter and wait between reading and writing it."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=30.0)
scenario.program("counter", "counter.py")
scenario.program("first", "visitor.py", "first")
scenario.program("second", "visitor.py", "second")
scenario.faults(delay=(0.0, 0.05))


@scenario.finally_
def each_ticket_has_its_number(world):
    lines = world.lines("first") + world.lines("second")
    tickets = [line.split()[-1] for line in lines if "ticket" in line]
    assert len(tickets) == len(set(tickets)), tickets

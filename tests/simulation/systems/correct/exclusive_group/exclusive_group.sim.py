"""Several threads share a counter, in a group that lets one callback run at a time."""

from taskrpc.simulation import Scenario

scenario = Scenario(duration=60.0)
scenario.program("counter", "counter.py")
scenario.program("first", "visitor.py", "first")
scenario.program("second", "visitor.py", "second")
scenario.faults(delay=(0.0, 0.1))


@scenario.finally_
def each_ticket_has_its_number(world):
    lines = world.lines("first") + world.lines("second")
    tickets = sorted(int(line.split()[-1]) for line in lines if "ticket" in line)
    assert tickets == [1, 2, 3, 4, 5, 6], tickets


@scenario.finally_
def counter_still_serves(world):
    assert world.call("ticket").sum == 7

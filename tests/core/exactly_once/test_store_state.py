"""A lease ends after a day in which servers ran, whatever the machine's clock does meanwhile."""

import pytest

from taskrpc.core.exactly_once.store_state import LeaseClock
from taskrpc.core.request_ids.ids import Completion, ReceivedId
from taskrpc.core.request_ids.ledger import CLIENT_LEASE, Ledger, Verdict

HOUR, YEAR = 3600.0, 365 * 24 * 3600.0


class Machine:
    """A machine on which servers of one store come and go; its clock may be wrong."""

    def __init__(self):
        self.uptime = 10.0
        self.wrong_by = 0.0
        self.stored = []
        self.boot()

    @property
    def wall(self):
        return 50 * YEAR + self.uptime + self.wrong_by

    def boot(self):
        """End the server, and start the next one."""
        self.clock = LeaseClock(self.stored, self.wall, self.uptime)
        self.ledger = Ledger(self.stored)

    def now(self):
        return self.clock.offset + self.uptime

    def ask(self, client=b"c" * 16):
        """Have a request of this client decided; one that is new runs at once."""
        for forgotten in self.ledger.expire(self.now()):
            self.stored = [each for each in self.stored if each.client != forgotten[1]]
        received = ReceivedId(client, 1, 1, b"")
        verdict = self.ledger.decide("", received, self.now())
        if verdict is Verdict.NEW:
            done = Completion("", client, 1, 1, b"", b"", 0, self.now())
            self.ledger.completed(done)
            self.stored.append(done)
        return verdict

    def age(self):
        """Seconds since the first completion."""
        return self.now() - self.stored[0].at


@pytest.fixture
def machine():
    return Machine()


def test_a_store_without_completions_begins_with_the_time_of_day(machine):
    assert machine.now() == machine.wall


@pytest.mark.parametrize("leap", [2 * CLIENT_LEASE, -2 * CLIENT_LEASE, 56 * YEAR])
def test_a_leap_while_a_server_runs_changes_nothing(machine, leap):
    machine.ask()
    machine.wrong_by += leap
    machine.uptime += HOUR
    assert machine.age() == pytest.approx(HOUR)


def test_no_number_of_leaps_between_servers_lets_a_request_run_twice(machine):
    assert machine.ask() is Verdict.NEW
    for number, days in enumerate((20, 40, 60, -90, 20)):
        machine.wrong_by += days * 24 * HOUR
        machine.uptime += 60.0
        machine.boot()
        # The completions of others let the clock go on.
        assert machine.ask(number.to_bytes(16, "big")) is Verdict.NEW
        assert machine.ask() is Verdict.DONE
    assert machine.age() < 600.0


def test_the_time_between_two_servers_does_not_count(machine):
    machine.ask()
    machine.uptime += 60 * HOUR
    machine.boot()
    assert machine.age() == 0.0


def test_a_day_in_which_servers_ran_ends_a_lease(machine):
    assert machine.ask() is Verdict.NEW
    for number in range(1, 13):
        assert machine.age() < CLIENT_LEASE
        machine.uptime += 2 * HOUR + 1.0
        machine.ask(number.to_bytes(16, "big"))
        machine.uptime += 22 * HOUR  # switched off
        machine.boot()
    assert machine.ask() is Verdict.NEW

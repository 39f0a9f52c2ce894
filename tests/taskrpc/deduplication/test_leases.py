"""No leap of the time of day ends a lease, and time that has really passed does count."""

import pytest

from taskrpc.deduplication.leases import DOWN_AT_MOST, LeaseClock
from taskrpc.wire.ledger import LEASE
from taskrpc.wire.once import Completion

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
        self.clock = LeaseClock(self.stored, self.wall, self.uptime)

    def now(self):
        return self.clock.offset + self.uptime

    def answer(self):
        done = Completion("", b"c" * 16, 1, 1, b"", b"", 0, self.now(), self.wall)
        self.stored.append(done)
        return done

    def age(self, completion):
        return self.now() - completion.at


@pytest.fixture
def machine():
    return Machine()


def test_a_store_without_completions_begins_with_the_time_of_day(machine):
    assert machine.now() == machine.wall


@pytest.mark.parametrize("leap", [2 * LEASE, -2 * LEASE, 56 * YEAR])
def test_a_leap_while_a_server_runs_changes_nothing(machine, leap):
    done = machine.answer()
    machine.wrong_by += leap
    machine.uptime += HOUR
    assert machine.age(done) == pytest.approx(HOUR)


@pytest.mark.parametrize("leap", [2 * LEASE, -2 * LEASE, 56 * YEAR])
def test_a_leap_while_no_server_runs_ends_no_lease_however_often_they_start(machine, leap):
    done = machine.answer()
    machine.wrong_by += leap
    for _ in range(10):
        machine.uptime += 1.0
        machine.boot()
    assert machine.age(done) <= DOWN_AT_MOST < LEASE
    machine.answer()
    machine.boot()
    assert machine.age(done) <= DOWN_AT_MOST + 1


def test_the_time_between_two_servers_counts_up_to_half_a_day(machine):
    done = machine.answer()
    machine.uptime += 8 * HOUR
    machine.boot()
    assert machine.age(done) == pytest.approx(8 * HOUR)
    machine.uptime += 60 * HOUR
    machine.boot()
    assert machine.age(done) == DOWN_AT_MOST


def test_a_server_a_day_ages_what_is_stored(machine):
    done = machine.answer()
    for _ in range(3):
        machine.uptime += 22 * HOUR  # switched off
        machine.boot()
        machine.uptime += 2 * HOUR
        machine.answer()
    assert machine.age(done) > LEASE


def test_what_an_earlier_version_has_stored_counts_by_its_only_time(machine):
    machine.stored.append(Completion("", b"c" * 16, 1, 1, b"", b"", 0, machine.wall - 2 * HOUR))
    machine.boot()
    assert machine.age(machine.stored[0]) == pytest.approx(2 * HOUR)

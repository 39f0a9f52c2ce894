"""A fleet in memory, for the tests of this folder."""

import pytest

from tests.robot.fleet.fakes import Fleet


@pytest.fixture
async def fleet():
    fleet = Fleet()
    yield fleet
    await fleet.close()

"""A scenario names programs, faults and checks, and refuses wrong values."""

import math

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.simulation import Scenario
from taskrpc.simulation.scenario import Faults, ProgramEntry


@pytest.fixture
def scenario():
    made = Scenario(duration=30)
    made.program("robot", "robot.py")
    made.program("student", "client.py", "--count", 5)
    return made


def test_programs_have_files_and_arguments(scenario):
    assert scenario.programs == [
        ProgramEntry("robot", "robot.py"),
        ProgramEntry("student", "client.py", ("--count", "5")),
    ]
    assert scenario.duration == 30.0


def test_without_faults_none_happens(scenario):
    assert scenario.fault_settings == Faults()


def test_faults_are_kept(scenario):
    scenario.faults(
        lose_requests=1, delay=(0, 0.2), cut=0.5, crash="robot", restart=[1, 2], until=9
    )
    assert scenario.fault_settings == Faults(
        lose_requests=1.0,
        delay=(0.0, 0.2),
        cut=0.5,
        crash=("robot",),
        restart=(1.0, 2.0),
        until=9.0,
    )


def test_checks_stay_functions(scenario):
    @scenario.always
    def one(world):
        return 1

    @scenario.finally_
    def other(world):
        return 2

    assert (one(None), other(None)) == (1, 2)
    assert (scenario.always_checks, scenario.final_checks) == ([one], [other])


@pytest.mark.parametrize("duration", [0, -1, math.inf, math.nan, "60"])
def test_wrong_duration_is_refused(duration):
    with pytest.raises(TaskRpcError, match="duration: expected seconds, got"):
        Scenario(duration)


@pytest.mark.parametrize("name", ["", "two words", "1st", "a/b"])
def test_wrong_program_name_is_refused(scenario, name):
    with pytest.raises(TaskRpcError, match="program: expected a name such as robot, got"):
        scenario.program(name, "a.py")


def test_second_program_with_a_name_is_refused(scenario):
    with pytest.raises(TaskRpcError, match="there are two programs with the name 'robot'"):
        scenario.program("robot", "other.py")


@pytest.mark.parametrize(
    ("faults", "problem"),
    [
        ({"lose_requests": 1.5}, "lose_requests: expected a share from 0 to 1, got 1.5"),
        ({"lose_responses": -0.1}, "lose_responses: expected a share from 0 to 1, got -0.1"),
        ({"busy": "often"}, "busy: expected a share from 0 to 1, got 'often'"),
        ({"delay": 0.2}, "delay: expected the least and the most seconds, such as .*, got 0.2"),
        ({"delay": (2, 1)}, r"delay: expected the least seconds first, got \(2, 1\)"),
        ({"delay": (-1, 1)}, "delay: expected seconds, got -1"),
        ({"crash": ["robot"], "restart": (0, math.inf)}, "restart: expected seconds, got inf"),
        ({"restart": (0, 1)}, r"restart: expected crash=\(…\) beside it"),
        ({"crash": ("robbot",)}, r"crash: expected names of programs \(robot, student\), got"),
        ({"slow": ("arm",)}, r"slow: expected names of programs \(robot, student\), got 'arm'"),
    ],
)
def test_wrong_fault_is_refused(scenario, faults, problem):
    with pytest.raises(TaskRpcError, match=problem):
        scenario.faults(**faults)


def test_fault_of_a_program_before_it_is_added_is_refused():
    with pytest.raises(TaskRpcError, match=r"expected names of programs \(no program yet\)"):
        Scenario().faults(crash=("robot",))


@pytest.mark.parametrize("fault", [{"delay": (0.2,)}, {"crash": 5}])
def test_value_of_a_wrong_kind_is_refused_too(scenario, fault):
    with pytest.raises(TaskRpcError):
        scenario.faults(**fault)

"""Module variables of taskrpc and rclpy differ between programs."""

import functools
import sys
from types import ModuleType

import pytest

from taskrpc.simulation.interpreter import state
from taskrpc.simulation.interpreter.state import ModuleState
from tests.simulation.small_programs import ROS_CLIENT, ROS_ROBOT


class TestInThisProcess:
    """The state of one module, exchanged by hand."""

    @pytest.fixture
    def module(self, monkeypatch):
        module = ModuleType("taskrpc.made_for_tests")
        module.__file__ = str(state.__file__).replace("simulation", "made", 1)
        vars(module).update(count=0, names=[], by_name={}, LIMIT=[1], text="text", other={})
        module.once = functools.cache(lambda: module.names.append("once"))
        module.of_argument = functools.cache(str)
        module.same = module.names
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return module

    def made(self):
        return ModuleState()

    def test_variables_are_small_values_and_containers_without_capitals(self, module):
        own = {each.rpartition(".")[2] for each in self.made().names if "made_for" in each}
        assert own == {"count", "names", "by_name", "same", "other", "once"}

    def test_each_program_sees_its_own_values(self, module):
        made = self.made()
        outside, first, second = made.take(), made.new(), made.new()
        try:
            made.put(first)
            module.count = 5
            module.names.append("first")
            first = made.take()
            made.put(second)
            assert (module.count, module.names) == (0, [])
            made.put(first)
            assert (module.count, module.names) == (5, ["first"])
        finally:
            made.put(outside)
        assert (module.count, module.names) == (0, [])

    def test_cached_function_without_arguments_runs_once_in_each_program(self, module):
        module.once()
        made = self.made()
        outside = made.take()
        try:
            for _ in range(2):
                made.put(made.new())
                module.names.clear()
                module.once()
                module.once()
                assert module.names == ["once"]
        finally:
            made.put(outside)

    def test_two_names_of_one_object_stay_one(self, module):
        made = self.made()
        outside = made.take()
        try:
            made.put(made.new())
            assert module.same is module.names
            assert module.same is not module.other
        finally:
            made.put(outside)

    def test_new_program_begins_with_what_was_there_when_the_state_was_made(self, module):
        module.names.append("imported")
        made = self.made()
        outside = made.take()
        module.names.append("later")
        try:
            made.put(made.new())
            assert module.names == ["imported"]
        finally:
            made.put(outside)


@pytest.mark.real_time
def test_programs_have_contexts_of_ros_of_their_own(simulated):
    code = """
        import rclpy, time
        print(rclpy.ok())
        rclpy.init()
        node = rclpy.create_node("node")
        time.sleep(1)
        print(rclpy.ok())
        rclpy.shutdown()
        print(rclpy.ok())
        """
    loaded = simulated(a=code, b=code)
    for seed in range(2):
        lines = loaded.run(seed).lines
        assert lines["a"] == lines["b"] == ["False", "True", "False"]


@pytest.mark.real_time
def test_logger_levels_of_ros_belong_to_their_program(simulated):
    code = """
        import rclpy, time
        from rclpy.logging import LoggingSeverity, get_logger, set_logger_level
        rclpy.init()
        set_logger_level("part", LoggingSeverity.{level})
        time.sleep(1)
        get_logger("part").info("information")
        get_logger("part").error("trouble")
        """
    lines = simulated(a=code.format(level="ERROR"), b=code.format(level="INFO")).run().lines
    assert [len(lines[name]) for name in "ab"] == [1, 2]


@pytest.mark.real_time
def test_programs_of_ros_call_each_other_again_after_other_runs(simulated):
    loaded = simulated(robot=ROS_ROBOT, client=ROS_CLIENT)
    first, again = loaded.run(3), None
    loaded.search(*range(4, 10))
    again = loaded.run(3)
    assert first.hash == again.hash
    assert sum("answer" in line for line in first.lines["client"]) == 3

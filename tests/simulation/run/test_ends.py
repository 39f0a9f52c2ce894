"""Programs that wait for ever fail a run, and the report says where."""

import pytest

from taskrpc.simulation.search.search import WorkerProcess
from tests.simulation.conftest import Workbench
from tests.simulation.small_programs import ROBOT, ROS_ROBOT

pytestmark = pytest.mark.real_time


def test_threads_that_wait_for_each_others_locks_are_a_deadlock(simulated):
    loaded = simulated(
        a="""
        import threading, time
        one, two = threading.Lock(), threading.Lock()
        def work(first, second):
            with first:
                time.sleep(0.1)
                with second:
                    print("both")
        threads = [threading.Thread(target=work, args=each) for each in ((one, two), (two, one))]
        for each in threads: each.start()
        for each in threads: each.join()
        """
    )
    failure = loaded.explain()
    assert failure.kind == "deadlock"
    assert failure.text.count("a thread of a waits at a.py:7 for a lock that another") == 2


def test_deadlock_is_told_rather_than_the_final_check_that_fails_because_of_it(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def program_ends(world):
            assert world.count("program", "done") == 1
        """,
        program="""
            import threading
            lock = threading.Lock()
            lock.acquire()
            lock.acquire()
            print("done")
            """,
    )
    assert loaded.explain(loaded.search(0).failed).kind == "deadlock"


def test_lock_taken_twice_is_a_deadlock(simulated):
    loaded = simulated(
        a="""
        import threading
        lock = threading.Lock()
        with lock:
            lock.acquire()
        """
    )
    failure = loaded.explain()
    assert failure.kind == "deadlock"
    assert "a.py:5" in failure.text


def test_condition_and_event_without_an_end_are_no_deadlock(simulated):
    loaded = simulated(
        duration=20,
        a="""
        import threading
        condition = threading.Condition()
        def work():
            with condition: condition.wait()
        threading.Thread(target=work).start()
        threading.Event().wait()
        """,
    )
    loaded.run()


@pytest.mark.parametrize("robot", [ROBOT, ROS_ROBOT])
def test_server_that_waits_for_requests_is_no_failure(simulated, robot):
    simulated(robot=robot, duration=30).run()


HANGING = """
    import rclpy
    from example_interfaces.srv import AddTwoInts
    rclpy.init()
    node = rclpy.create_node("client")
    client = node.create_client(AddTwoInts, "pick")
    client.wait_for_service()
    future = client.call_async(AddTwoInts.Request(a=1))
    rclpy.spin_until_future_complete(node, future)
    print("answer")
    """


def test_call_without_a_response_is_found_when_the_program_waits_for_it(simulated):
    loaded = simulated("scenario.faults(lose_requests=0.5)", robot=ROS_ROBOT, client=HANGING)
    failure = loaded.first_failure()
    assert failure.kind == "a call that nobody answers"
    assert failure.text.startswith("client waits since ")
    assert "for the response of /pick, which it called at client.py:8" in failure.text
    assert failure.faults == ["lose request 1 of /pick"]
    assert failure.groups == []
    assert any("client.py:8" in line for line in failure.waits)


def test_program_that_goes_on_without_the_response_is_no_failure(simulated):
    loaded = simulated(
        "scenario.faults(lose_requests=1.0)",
        robot=ROS_ROBOT,
        client=HANGING.replace("future)", "future, timeout_sec=1.0)"),
    )
    assert loaded.run().lines["client"] == ["answer"]


def test_callback_that_waits_for_ever_is_found(simulated):
    loaded = simulated(
        a="""
        import threading
        import rclpy
        rclpy.init()
        node = rclpy.create_node("a")
        def tick():
            threading.Event().wait()
        node.create_timer(1.0, tick)
        rclpy.spin(node)
        """
    )
    failure = loaded.explain()
    assert failure.kind == "a callback that never ends"
    assert failure.text == "a callback of a waits for ever at a.py:7"


def test_line_of_a_call_of_rclpy_is_known_in_a_process_that_simulated_without_rclpy_before(
    tmp_path,
):
    with WorkerProcess() as worker:
        simulated = Workbench(worker, tmp_path)
        simulated(robot=ROBOT, duration=1).run()
        loaded = simulated("scenario.faults(lose_requests=0.5)", robot=ROS_ROBOT, client=HANGING)
        assert "which it called at client.py:8" in loaded.first_failure().text


def test_killed_program_has_no_deadlock(simulated):
    code = """
        import threading, time
        lock = threading.Lock()
        lock.acquire()
        threading.Thread(target=lambda: lock.acquire(), daemon=True).start()
        print("works")
        lock.acquire()
        """
    loaded = simulated("scenario.faults(crash=('a',))", a=code, duration=5)
    answers = [loaded.search(seed) for seed in range(40)]
    killed = [each for each in answers if each.coverage.faults]
    assert killed
    assert all(each.failed is None for each in killed)
    assert any(each.failed is not None for each in answers)

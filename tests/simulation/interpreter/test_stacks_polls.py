"""Programs that poll: time passes for them, and one that polls for ever is reported."""

from taskrpc.simulation.interpreter.stacks import Stacks, Stop
from taskrpc.simulation.interpreter.threads import Handle


def test_time_passes_for_a_stack_that_only_lets_others_run():
    stacks = Stacks()

    def poll():
        while stacks.now < 10.0:
            stacks.sleep(0)

    try:
        stacks.start(poll, Handle())
        assert stacks.run(100.0, lambda _: 0, lambda: stacks.steps > 100_000) is Stop.IDLE
    finally:
        stacks.reset()


def test_program_that_spins_without_waiting_gets_its_response(simulated):
    server = """
        import rclpy
        from std_srvs.srv import Trigger

        rclpy.init()
        node = rclpy.create_node("server")
        node.create_service(Trigger, "wave", lambda request, response: response)
        rclpy.spin(node)
    """
    client = """
        import rclpy
        from std_srvs.srv import Trigger

        rclpy.init()
        node = rclpy.create_node("client")
        future = node.create_client(Trigger, "wave").call_async(Trigger.Request())
        while not future.done():
            rclpy.spin_once(node, timeout_sec=0)
        print("waved")
        while rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0)
    """
    more = "scenario.faults(delay=(0.1, 0.3))"
    run = simulated(more, server=server, client=client, duration=12.0).run()
    assert run.lines["client"] == ["waved"]


def test_program_that_polls_a_clock_for_ever_is_reported(simulated):
    code = """
        import time

        is_done = False
        while not is_done:
            time.monotonic()
    """
    found = simulated(a=code, duration=20.0).first_failure(1)
    assert found.kind == "a never waits"
    assert "a.py:6" in found.text


def test_program_that_polls_a_clock_and_works_is_not_reported(simulated):
    code = """
        import time

        for number in range(4):
            end = time.monotonic() + 5.0
            while time.monotonic() < end:
                pass
            print(number)
    """
    assert simulated(a=code, duration=18.0).run().lines["a"] == ["0", "1", "2"]

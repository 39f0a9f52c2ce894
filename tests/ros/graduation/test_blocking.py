"""`taskrpc graduate` reports calls, loops and service callbacks that wait for ever on ROS 2."""

import pytest

from tests.ros.graduation.sample_programs import (
    ANSWERS,
    AWAITS,
    HELPED,
    OVERLAPS,
    REQUEST,
    SERVICE,
    TIMER,
    WAITS,
    method,
    program,
)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (program(TIMER, HELPED), "self.client.call inside a callback (tick > ask); ROS 2 hangs"),
        (
            program(
                TIMER,
                method(
                    "def tick(self):",
                    f"f = self.client.call_async({REQUEST})",
                    "rclpy.spin_until_future_complete(self, f)",
                ),
            ),
            "spin_until_future_complete inside a callback (tick); ROS 2 hangs, or",
        ),
        (
            program(
                main="try:\n        def tick():\n            time.sleep(5)\n"
                "        node.create_timer(1.0, tick)\n    finally:\n        rclpy.spin(node)"
            ),
            "sleep inside a callback (tick); ROS 2 runs no other callback",
        ),
        (
            program(TIMER, method("def tick(self):", "time.sleep(5)")),
            "sleep inside a callback (tick); ROS 2 runs no other callback",
        ),
        (
            program(main=f"node.client.call({REQUEST})").replace("node.client", "self.client"),
            "self.client.call while no other thread spins; ROS 2 waits for ever",
        ),
        (
            program(
                main="for n in range(50): self.client.call_async(AddTwoInts.Request(a=n))\n"
                "    rclpy.spin(node)"
            ),
            "call_async in a loop that does not wait; ROS 2 keeps 10 requests",
        ),
        (
            program(
                main=f"print(self.client.call_async({REQUEST}).result())\n    rclpy.spin(node)"
            ),
            "result() of a call that was only just sent; it is None",
        ),
        (
            program(main=f"f = self.client.call_async({REQUEST})\n    while not f.done(): pass"),
            "a loop that waits for a future and does not spin; ROS 2 never leaves it",
        ),
        (
            program(main=f"self.client.call_async({REQUEST})"),
            "call_async in a program that never spins; ROS 2 never receives the response",
        ),
        (
            program(SERVICE, method("def add(self, request, response):", "response.sum = 1")),
            "add can end without return response; the server ends with an error",
        ),
        (
            program(
                SERVICE,
                method("def add(self, request, response):", "if request.a:", "    return response"),
            ),
            "add can end without return response",
        ),
        (
            program(SERVICE, method("def add(self, request, response):", "return True")),
            "add returns True; the server ends with an error",
        ),
        (
            program(
                SERVICE,
                method("def add(self, request, response):", "raise ValueError('no')"),
            ),
            "a raise in a service callback; the server ends with an error",
        ),
        (
            program(f"{SERVICE}; {SERVICE}", method("def add(self, q, r):", "return r")),
            "a second server of 'sum'; in ROS 2 both execute each request",
        ),
        (
            program().replace("while not self.client.wait_for_service(timeout_sec=1.0):", "if 1:")
            + f"\nself.client.call_async({REQUEST})\n",
            "self.client calls without wait_for_service; ROS 2 loses a request that it sends",
        ),
    ],
)
def test_waiting_for_ever_is_reported(graduate, text, what):
    found = graduate(text)
    assert [line for line in found if what in line], found
    assert all(line.startswith("program.py:") for line in found)


def test_finding_has_position_and_fix(graduate):
    text = program(TIMER, method("def tick(self):", f"self.client.call({REQUEST})"))
    line = 1 + text[: text.index("self.client.call(")].count("\n")
    assert graduate(text) == [
        f"program.py:{line}:9: self.client.call inside a callback (tick);"
        " ROS 2 hangs: the thread that should receive the response waits for it;"
        " use await call_async(...) in an async def callback, or add_done_callback"
    ]


@pytest.mark.parametrize(
    "text",
    [
        program(),
        program(SERVICE, ANSWERS),
        program(TIMER, AWAITS),
        program(main=WAITS),
        program(main=f"[self.client.call_async({REQUEST}) for n in range(10)]; rclpy.spin(node)"),
        program(
            main="threading.Thread(target=rclpy.spin, args=(node,)).start()\n"
            f"    self.client.call({REQUEST})"
        ),
        OVERLAPS
        + program(
            "self.create_timer(1.0, self.tick, callback_group=ReentrantCallbackGroup())",
            HELPED,
            "MultiThreadedExecutor().spin()",
        ),
        program(
            main="threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()\n"
            f"    self.client.call_async({REQUEST}).add_done_callback(print)"
        ),
        program(main="Int8(data=127)"),
        "print('no ROS at all')\n",
    ],
)
def test_program_that_behaves_the_same_has_no_findings(graduate, text):
    assert graduate(text) == []

"""`taskrpc graduate` reports arguments, names and values that rclpy or ROS 2 rejects."""

import pytest

from tests.ros.graduation.sample_programs import REQUEST, SERVICE, method, program


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (
            program(main=f"self.client.call_async({REQUEST}, retry=3)\n    rclpy.spin(node)"),
            "call_async(retry=...); rclpy does not know the argument: TypeError; repeat only",
        ),
        (
            program().replace("import time", "import taskrpc"),
            "taskrpc is imported; ROS 2 does not have it",
        ),
        (
            program(main="rclpy.spin(node)").replace("    rclpy.shutdown()\n", ""),
            "rclpy.init() without rclpy.shutdown()",
        ),
        (
            program().replace("    rclpy.init()\n", ""),
            "rclpy is used without rclpy.init(); ROS 2 raises NotInitializedException",
        ),
        (program().replace('"adder"', '"my adder"'), "the name 'my adder'; ROS 2 rejects it: "),
        (program().replace('"add"', '"add-two"'), "the name 'add-two'; ROS 2 rejects it: "),
        (program(main="Int8(data=300)"), "300 for the int8 data; ROS 2 rejects it, or wraps"),
        (
            program(main="q = AddTwoInts.Request()\n    q.a = 2.5"),
            "2.5 for the int64 a; ROS 2 rejects it or changes it; write an int",
        ),
        (
            program(SERVICE, method("def add(self, q, r):", "r.sum = 'x'", "return r")),
            "'x' for the int64 sum",
        ),
        (
            program().replace("import time", "from rclpy.experimental import AsyncNode"),
            "AsyncNode is used; it needs ROS 2 Lyrical or newer",
        ),
        (
            program(main="rclpy.experimental.AsyncNode('x')"),
            "AsyncNode is used; it needs ROS 2 Lyrical or newer",
        ),
        (program(main="cmd = 'ros2 service list --json'"), "--json; the ros2 commands do not"),
    ],
)
def test_calls_and_values_that_rclpy_rejects_are_reported(graduate, text, what):
    found = graduate(text)
    assert [line for line in found if what in line], found
    assert all(line.startswith("program.py:") for line in found)

"""After the shutdown, rclpy refuses the same here and in the real rclpy, in the same words."""

from __future__ import annotations

import sys

import pytest

from tests.interop.conftest import FOLDER
from tests.interop.test_ros_actions import output

PROGRAM = FOLDER / "ros_after_shutdown_program.py"
_NO_EXECUTOR = (
    "raises RuntimeError: Context must be initialized before an executor can be created:"
    " rclpy.init() comes first"
)
_DESTROYED = "raises InvalidHandle: cannot use Destroyable because destruction was requested"
DIFFERENT = {
    # The name of a destroyed client or service stays known; ours is for the explanations.
    ("shutdown", "Client.service_name"): "returns '/absent'",
    ("shutdown", "Service.service_name"): "returns '/serve'",
    # ROS returns a future that is never done.
    ("shutdown", "ActionClient.send_goal_async"): _DESTROYED,
    # The same exception, in a sentence that names the mistake.
    **{
        ("shutdown", name): _NO_EXECUTOR
        for name in (
            "spin",
            "spin_once",
            "spin_once()",
            "spin_until_future_complete",
            "spin_until_future_complete(timeout)",
            "SingleThreadedExecutor()",
            "MultiThreadedExecutor()",
        )
    },
    # ROS waits for ever, until the program calls `rclpy.shutdown()`.
    ("signal", "Rate.sleep"): "raises ROSInterruptException: rclpy.shutdown() has been called",
}
"""What taskrpc does where it differs, by the way to end and the call."""


@pytest.mark.parametrize("how", ["shutdown", "signal"])
def test_calls_after_the_shutdown_do_as_in_ros(ros_python, how):
    there, _ = output([ros_python], PROGRAM, how)
    here, _ = output([sys.executable, "-m", "taskrpc", "run"], PROGRAM, how)
    assert len(there) > 120
    expected = [
        f"{name}: {DIFFERENT.get((how, name), result)}"
        for name, _, result in (line.partition(": ") for line in there)
    ]
    assert here == expected
    assert here != there  # else the table above has entries that nothing needs

"""draw_square."""

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]


def test_the_turtle_is_reset_and_drives_ahead(turtlesim):
    node = turtlesim.node()
    square, _ = turtlesim.run("draw_square")
    node.wait_for("Resetting turtlesim.")
    square.wait_for("New goal [7.544445 5.544445, 0.000000]")
    square.wait_for("Reached goal")
    assert square.interrupt() == 0

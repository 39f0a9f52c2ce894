"""Goal ids are shown as numpy shows them in ROS."""

from taskrpc.ros.packages.rclpy._impl.actions.goal_ids import shown


def test_numbers_have_the_width_of_the_longest():
    assert shown(bytes([7] * 16)) == f"[{' '.join('7' * 16)}]"
    assert shown(bytes([128, 9, *[10] * 14])) == f"[128   9{'  10' * 14}]"

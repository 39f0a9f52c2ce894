"""Handles report arrived items, and refuse use after their destruction."""

import pytest

from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle
from taskrpc.ros.packages.rclpy.handle import ArrivalHandle, Handle


def test_a_late_callback_receives_the_number_of_earlier_items():
    handle, told = ArrivalHandle(), []
    handle.item_arrived()
    handle.item_arrived()
    handle.set_on_new_callback(told.append)
    handle.item_arrived()
    assert told == [2, 1]


def test_a_cleared_callback_is_not_called():
    handle, told = ArrivalHandle(), []
    handle.set_on_new_callback(told.append)
    handle.clear_on_new_callback()
    handle.item_arrived()
    assert told == []


def test_a_destroyed_handle_cannot_be_entered():
    handle = Handle()
    handle.destroy_when_not_in_use()
    with pytest.raises(InvalidHandle), handle:
        pass

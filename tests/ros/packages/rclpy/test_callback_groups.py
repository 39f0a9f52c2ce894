"""Callback groups decide which callbacks may run at the same time."""

from __future__ import annotations

import gc

from taskrpc.ros.packages.rclpy._impl.execution.entity import Entity
from taskrpc.ros.packages.rclpy.callback_groups import (
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)


def test_reentrant_group_allows_all_callbacks_at_the_same_time():
    group, one, two = ReentrantCallbackGroup(), Entity(), Entity()
    for entity in (one, two, one):
        assert group.can_execute(entity)
        assert group.beginning_execution(entity)
    group.ending_execution(one)


def test_exclusive_group_allows_one_callback_until_it_has_ended():
    group, one, two = MutuallyExclusiveCallbackGroup(), Entity(), Entity()
    assert group.can_execute(one)
    assert group.beginning_execution(one)
    assert not group.can_execute(two)
    assert not group.beginning_execution(two)
    group.ending_execution(two)
    assert not group.can_execute(two)
    group.ending_execution(one)
    assert group.beginning_execution(two)


def test_group_knows_its_entities_and_does_not_keep_them_alive():
    group, one = ReentrantCallbackGroup(), Entity()
    group.add_entity(one)
    assert group.has_entity(one)
    assert not group.has_entity(Entity())
    del one
    gc.collect()
    assert [reference() for reference in group.entities] == [None]

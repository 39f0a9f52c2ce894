"""Lookups that wait: until a transform arrives, until the timeout, or as a future."""

import threading

import pytest


def result_of(coroutine):
    with pytest.raises(StopIteration) as caught:
        coroutine.send(None)
    coroutine.close()
    return caught.value.value


def test_known_transform_is_returned_at_once(ros, link):
    buffer = ros.tf2_ros.Buffer()
    sent = link("foo", "bar", x=42.0, y=-3.14)
    now = ros.Time(seconds=1)
    assert buffer.set_transform(sent, "unittest") is None
    assert buffer.can_transform("foo", "bar", now) is True
    assert buffer.lookup_transform("foo", "bar", now) == sent
    assert buffer.lookup_transform_full("foo", now, "bar", now, "foo") == sent
    assert buffer.can_transform_full("foo", now, "bar", now, "foo")
    assert result_of(buffer.lookup_transform_async("foo", "bar", now)) == sent
    assert result_of(buffer.lookup_transform_full_async("foo", now, "bar", now, "foo")) == sent


def test_awaited_transform_is_returned_when_it_arrives(ros, link):
    buffer = ros.tf2_ros.Buffer()
    now = ros.Time(seconds=1)
    waiting = [
        buffer.lookup_transform_async("foo", "bar", now),
        buffer.lookup_transform_full_async("foo", now, "bar", now, "foo"),
    ]
    for coroutine in waiting:
        coroutine.send(None)
    buffer.set_transform_static(link("elsewhere", "thing"), "unittest")
    sent = link("foo", "bar")
    buffer.set_transform(sent, "unittest")
    assert [result_of(coroutine) for coroutine in waiting] == [sent, sent]
    assert buffer._waiters == []


def test_cancelled_wait_is_forgotten(ros, link):
    buffer = ros.tf2_ros.Buffer()
    future = buffer.wait_for_transform_async("foo", "bar", ros.Time())
    assert len(buffer._waiters) == 1
    future.cancel()
    buffer.set_transform(link("foo", "bar"), "unittest")
    assert (buffer._waiters, future.done()) == ([], False)


def test_lookup_without_a_timeout_fails_at_once(ros):
    buffer = ros.tf2_ros.Buffer()
    with pytest.raises(ros.tf2_ros.LookupException, match="does not exist"):
        buffer.lookup_transform("foo", "bar", ros.Time())
    found, why_not = buffer.can_transform("a", "b", ros.Time(), return_debug_tuple=True)
    assert found is False
    assert why_not.endswith("frame does not exist")
    with pytest.raises(TypeError, match=r"expected rclpy.duration.Duration as timeout, got float"):
        buffer.lookup_transform("foo", "bar", ros.Time(), 1.0)


@pytest.mark.real_time
def test_lookup_waits_for_a_transform_from_another_thread(ros, link):
    buffer = ros.tf2_ros.Buffer()
    sent = link("foo", "bar")
    timer = threading.Timer(0.02, buffer.set_transform, (sent, "unittest"))
    timer.start()
    patience = ros.Duration(seconds=60)
    assert buffer.lookup_transform("foo", "bar", ros.Time(), patience) == sent
    timer.join()


@pytest.mark.real_time
def test_lookup_fails_after_its_timeout(ros, link):
    buffer = ros.tf2_ros.Buffer()
    buffer.set_transform(link("a", "bar"), "unittest")
    with pytest.raises(ros.tf2_ros.LookupException, match="target_frame does not exist"):
        buffer.lookup_transform("foo", "bar", ros.Time(), ros.Duration(seconds=0.01))
    now = ros.Time()
    brief = ros.Duration(seconds=0.01)
    assert not buffer.can_transform_full("foo", now, "bar", now, "a", brief)


def test_service_tells_all_frames(ros, link, node):
    buffer = ros.tf2_ros.Buffer(ros.Duration(seconds=5), node)
    buffer.set_transform(link("foo", "bar"), "me")
    (service,) = node.made
    assert service.name == "tf2_frames"
    response = service.callback(service.kind.Request(), service.kind.Response())
    assert response.frame_yaml == buffer.all_frames_as_yaml()
    assert "parent: 'foo'" in response.frame_yaml


def test_jump_back_in_time_clears_the_buffer(ros, link, node, capfd):
    buffer = ros.tf2_ros.Buffer(node=node)
    buffer.set_transform(link("foo", "bar"), "me")
    assert buffer.jump_handle.threshold.min_backward == ros.Duration(seconds=-1)
    buffer.jump_handle.post_callback(None)
    assert not buffer.can_transform("foo", "bar", ros.Time())
    assert "Detected jump back in time. Clearing tf buffer." in capfd.readouterr().err

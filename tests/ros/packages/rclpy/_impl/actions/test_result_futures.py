"""Requests for results are answered once there is a result, and after a cancellation's response."""

import pytest

from taskrpc.ros.packages.rclpy._impl.actions.result_futures import ResultFutures

GOAL = b"g" * 16


@pytest.fixture
def sent():
    return []


@pytest.fixture
def results(sent):
    found = ResultFutures(lambda response, header: sent.append((response, header)))
    found.add(GOAL)
    return found


def test_request_is_answered_when_there_is_a_result(results, sent):
    assert results.request(GOAL, "first", None)
    assert results.is_open(GOAL)
    assert sent == []
    results.complete(GOAL, "done")
    assert not results.is_open(GOAL)
    assert results.request(GOAL, "second", None)
    assert sent == [("done", "first"), ("done", "second")]


def test_unknown_and_forgotten_goals_have_no_result(results, sent):
    assert not results.request(b"other", "header", None)
    results.forget(GOAL)
    assert not results.is_open(GOAL)
    assert not results.request(GOAL, "header", None)
    results.complete(GOAL, "done")
    assert sent == []


def test_result_waits_for_the_response_to_a_cancellation(results, sent):
    results.request(GOAL, "header", None)
    assert results.hold(GOAL)
    assert not results.hold(GOAL)
    assert results.is_open(GOAL)
    results.complete(GOAL, "canceled")
    assert not results.is_open(GOAL)
    assert sent == []
    results.release(GOAL)
    assert sent == [("canceled", "header")]


def test_released_goal_without_a_result_gets_it_later(results, sent):
    results.request(GOAL, "header", None)
    results.hold(GOAL)
    results.release(GOAL)
    assert sent == []
    results.complete(GOAL, "done")
    assert sent == [("done", "header")]


def test_waiting_requests_can_be_taken_to_be_refused(results):
    results.request(GOAL, "header", None)
    assert results.take_waiting() == ["header"]
    assert results.take_waiting() == []

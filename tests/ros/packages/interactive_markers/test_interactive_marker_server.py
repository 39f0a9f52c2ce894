"""The server of interactive markers: changes, updates for views, and feedback of users."""

import importlib

import pytest


@pytest.fixture
def insert(server, messages):
    def insert(name, **options):
        server.insert(messages.InteractiveMarker(name=name), **options)

    return insert


@pytest.fixture
def feedback(server, messages, pose):
    def send(kind="POSE_UPDATE", x=0.0, name="a", client="rviz"):
        kind = getattr(messages.InteractiveMarkerFeedback, kind)
        message = messages.InteractiveMarkerFeedback(
            marker_name=name, client_id=client, event_type=kind, pose=pose(x)
        )
        server.processFeedback(message)

    return send


def names(update):
    return [[one.name for one in update.markers], [one.name for one in update.poses], update.erases]


def test_changes_are_published_together_by_apply(server, node, insert, pose):
    insert("a")
    insert("b")
    assert (node.published, server.get("a").name) == ([], "a")
    server.applyChanges()
    server.applyChanges()
    assert server.setPose("a", pose(1.0))
    assert server.erase("b")
    insert("c")
    assert not server.setPose("c", pose(1.0))  # as in ROS: it is not applied
    server.applyChanges()
    assert list(map(names, node.published)) == [[["a", "b"], [], []], [["c"], ["a"], ["b"]]]
    assert [update.seq_num for update in node.published] == [1, 2]
    assert node.published[1].poses[0].pose.position.x == 1.0
    assert server.get("a").pose.position.x == 1.0
    assert server.get("b") is None


def test_marker_without_a_name_known_is_not_changed(server, pose):
    assert not server.setPose("a", pose(1.0))
    assert not server.erase("a")
    assert not server.setCallback("a", print)
    assert server.get("a") is None


def test_a_view_that_joins_late_gets_all_markers(server, node, insert):
    response = importlib.import_module("visualization_msgs.srv").GetInteractiveMarkers.Response()
    insert("a")
    server.applyChanges()
    found = node.created["sim/get_interactive_markers"](None, response)
    assert (found.sequence_number, [one.name for one in found.markers]) == (1, ["a"])


def test_feedback_moves_the_marker_and_calls_the_callback_of_its_type(
    server, insert, messages, feedback
):
    called = []
    insert("a", feedback_callback=lambda one: called.append("other"))
    server.setCallback(
        "a", lambda one: called.append("click"), messages.InteractiveMarkerFeedback.BUTTON_CLICK
    )
    feedback()
    assert called == []  # the views do not know the marker yet
    server.applyChanges()
    feedback(x=2.0)
    feedback("BUTTON_CLICK")
    feedback(name="unknown")
    assert called == ["other", "click"]
    assert server.get("a").pose.position.x == 2.0
    server.setCallback("a", None)
    feedback()
    assert called == ["other", "click"]


def test_one_view_at_a_time_moves_a_marker(server, node, insert, feedback):
    insert("a")
    server.applyChanges()
    feedback(x=1.0, client="ada")
    feedback(x=2.0, client="ben")
    assert server.get("a").pose.position.x == 1.0
    node.seconds = 1.0
    feedback(x=2.0, client="ben")
    assert server.get("a").pose.position.x == 2.0


def test_shutdown_erases_the_markers_and_destroys_everything(server, node, insert):
    insert("a")
    server.applyChanges()
    server.shutdown()
    assert node.published[-1].erases == ["a"]
    assert len(node.destroyed) == 3

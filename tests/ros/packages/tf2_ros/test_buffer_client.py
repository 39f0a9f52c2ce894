"""Lookups in another process, with a server that the test plays."""

from types import SimpleNamespace

import pytest


class Done:
    """A future that has its result."""

    def __init__(self, result):
        self.result = lambda: result

    def add_done_callback(self, callback):
        callback(self)


class Silent:
    """A future that never gets a result."""

    def add_done_callback(self, callback):
        pass


class Server:
    """Stands for the action client and its server."""

    def __init__(self, result=None, *, ready=True, accepted=True):
        self.result, self.ready, self.accepted = result, ready, accepted
        self.goals = []

    def server_is_ready(self):
        return self.ready

    def send_goal_async(self, goal):
        self.goals.append(goal)
        if self.result is None and self.accepted:
            return Silent()
        answer = Done(SimpleNamespace(result=self.result))
        return Done(SimpleNamespace(accepted=self.accepted, get_result_async=lambda: answer))


@pytest.fixture
def client(ros, monkeypatch):
    module = ros.module("tf2_ros.buffer_client")
    monkeypatch.setattr(module, "ActionClient", lambda *_, action_name: Server(ready=False))
    return ros.tf2_ros.BufferClient(None, "buffer", timeout_padding=ros.Duration(seconds=0.001))


def answer(ros, error=0, text="", **fields):
    result = ros.module("tf2_msgs.action").LookupTransform.Result(**fields)
    result.error.error, result.error.error_string = error, text
    return result


def test_answer_of_the_server_is_returned(ros, client, link):
    sent = link("a", "b")
    client.action_client = server = Server(answer(ros, transform=sent))
    time = ros.Time(seconds=7)
    assert client.lookup_transform("a", "b", time, ros.Duration(seconds=2)) == sent
    assert client.lookup_transform_full("a", time, "b", time.to_msg(), "c") == sent
    assert client.can_transform("a", "b", time)
    assert client.can_transform_full("a", time, "b", time, "c")
    simple, full = server.goals[:2]
    assert (simple.source_time.sec, simple.timeout.sec, simple.advanced) == (7, 2, False)
    assert (full.target_time.sec, full.fixed_frame, full.advanced) == (7, "c", True)


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (1, "Lookup"),
        (2, "Connectivity"),
        (3, "Extrapolation"),
        (4, "InvalidArgument"),
        (6, "Transform"),
    ],
)
def test_errors_of_the_server_are_raised(ros, client, error, kind):
    client.action_client = Server(answer(ros, error, "why"))
    with pytest.raises(getattr(ros.tf2_ros, f"{kind}Exception"), match=r"^why$"):
        client.lookup_transform("a", "b", ros.Time())
    assert not client.can_transform("a", "b", ros.Time())
    assert not client.can_transform_full("a", ros.Time(), "b", ros.Time(), "c")


@pytest.mark.real_time
def test_missing_and_silent_servers_are_reported(ros, client):
    timeout = ros.tf2_ros.TimeoutException
    with pytest.raises(timeout, match=r"^The BufferServer is not ready\.$"):
        client.lookup_transform("a", "b", ros.Time())
    client.action_client = Server()
    with pytest.raises(timeout, match="did not come back in the specified time"):
        client.lookup_transform("a", "b", ros.Time())
    client.action_client = Server(accepted=False)
    with pytest.raises(timeout, match="did not come back with accepted status"):
        client.lookup_transform("a", "b", ros.Time())

"""What the environment and the arguments of a node say about its network."""

import pytest

import taskrpc
from taskrpc.core.transport.settings import Settings, domain_id, environment_peers


@pytest.mark.parametrize("text", ["-1", "233", "1.5", "x", "0x1", "²", "1 2"])
async def test_a_wrong_domain_is_refused_in_one_sentence(monkeypatch, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    message = f"ROS_DOMAIN_ID: expected a number from 0 to 232, got '{text}'"
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        await taskrpc.Node("node").start()
    assert str(caught.value) == message


@pytest.mark.parametrize(("text", "number"), [("", 0), (" 3 ", 3), ("232", 232)])
def test_a_domain_is_read(monkeypatch, text, number):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert domain_id() == number


def test_peers_of_the_environment_are_read(monkeypatch):
    monkeypatch.setenv("TASKRPC_PEERS", "a:1,b:2 ;c:3")
    assert environment_peers() == ["a:1", "b:2", "c:3"]


def test_equal_settings_are_one_key():
    one = Settings(domain=1, peers=("a:1",), token=b"x", tls=taskrpc.Tls(ca="ca.pem"))
    other = Settings(domain=1, peers=("a:1",), token=b"x", tls=taskrpc.Tls(ca="ca.pem"))
    assert hash(one) == hash(other)
    assert one == other
    assert one != Settings(domain=1, peers=("a:1",), token=b"y", tls=taskrpc.Tls(ca="ca.pem"))


def test_the_token_is_not_shown():
    assert "secret" not in repr(Settings(domain=0, token=b"secret"))


def test_without_accounts_there_is_no_source():
    assert Settings(domain=0).account_source() is None
    accounts = taskrpc.Accounts([taskrpc.Account("ana", "anas-secret-anas")])
    assert Settings(domain=0, accounts=accounts).account_source().current is accounts

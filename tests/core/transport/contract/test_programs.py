"""Programs beside each other: domains, accounts, statistics."""

from __future__ import annotations

import pytest

import taskrpc
from tests.core.transport.helpers import Add, add, ask, outcome, until, until_seen


async def test_domains_do_not_see_each_other(net, monkeypatch):
    server = await net.node()
    server.create_service(Add, "add", add)
    with monkeypatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", "101")  # that of no other test; see `own_domains`
        stranger = await net.node("stranger")
    client = stranger.create_client(Add, "add")
    assert not await client.wait_for_service(0.2)
    assert isinstance(await outcome(client.call(ask())), taskrpc.ServiceUnavailable)
    assert "/server" not in [name for entry in await stranger.graph() for name in entry.nodes]
    friend = await net.client(Add, "add", node="friend")
    assert await friend.wait_for_service(60)
    assert (await friend.call(ask(1, 2))).sum == 3


async def test_accounts_call_with_their_roles_and_others_are_refused(net, tmp_path):
    ana = taskrpc.Account("ana", "anas-secret-anas")
    gone = taskrpc.Account("gone", "gones-secret-gone", revoked=True)
    server = await net.node(accounts=taskrpc.Accounts([ana, gone]))
    server.create_service(Add, "add", lambda request, response: who(response))
    server.create_service(Add, "steer", add, role=taskrpc.Role.OPERATE)
    options = net.reaching(server)
    hers = await net.node("ana", **options, token=ana.token)
    theirs = await net.node("gone", **options, token=gone.token)
    may, may_not, revoked = (
        hers.create_client(Add, "add"),
        hers.create_client(Add, "steer"),
        theirs.create_client(Add, "add"),
    )
    assert await may.wait_for_service(60)
    assert (await may.call(ask())).sum == 7
    with pytest.raises(taskrpc.PermissionDenied, match="the account ana has submit"):
        await may_not.call(ask())
    with pytest.raises(taskrpc.AuthenticationFailed):
        await revoked.call(ask())


def who(response):
    assert taskrpc.current_call().principal == "ana"
    response.sum = 7
    return response


async def test_a_program_with_another_secret_is_refused(net):
    server = await net.node(token="the servers secret")
    server.create_service(Add, "add", add)
    options = net.reaching(server)
    stranger = await net.node("stranger", **options, token="another secret")
    client = stranger.create_client(Add, "add")
    if net.shares_secrets:  # the stranger finds the server's own secret
        assert await client.wait_for_service(60)
        assert (await client.call(ask(1, 2))).sum == 3
        return
    assert not await client.wait_for_service(0.2)
    assert isinstance(await outcome(client.call(ask())), taskrpc.AuthenticationFailed)
    friend = await net.node("friend", **options, token="the servers secret")
    client = friend.create_client(Add, "add")
    assert await client.wait_for_service(60)
    assert (await client.call(ask(1, 2))).sum == 3


async def test_statistics_come_from_each_program_that_offers_anything(net):
    server, caller, top = [await net.node(name) for name in ("server", "caller", "top")]
    server.create_service(Add, "add", add)
    client = caller.create_client(Add, "add")
    assert await client.wait_for_service(60)

    async def of_server():
        (found,) = [each for each in await top.statistics() if "/server" in each.entry.nodes]
        assert found.statistics is not None, found.problem
        return found.statistics

    await until_seen(top, lambda entries: any("/server" in each.nodes for each in entries))
    await of_server()
    for number in range(3):
        await client.call(ask(number))
    counted = await of_server()
    assert counted.callers == {"/caller": 3}
    assert [each.codes for each in counted.services] == [{0: 3}]


async def test_a_client_reaches_the_server_of_a_name_that_is_left(net):
    first, second = await net.node("first"), await net.node("second")
    first.create_service(Add, "add", add)
    client = await net.client(Add, "add")
    assert await client.wait_for_service(60)
    second.create_service(Add, "add", add, join=True)
    await first.destroy()
    assert await client.wait_for_service(60)
    assert (await client.call(ask(1, 2))).sum == 3
    await second.destroy()
    await until(lambda: not client._channel.ready)
    assert isinstance(await outcome(client.call(ask())), taskrpc.ServiceUnavailable)

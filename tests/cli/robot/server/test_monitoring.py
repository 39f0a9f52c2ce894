"""The pages of `taskrpc-server --web`: who may see them, and how their server ends."""

import asyncio
import hmac
import time

import aiohttp
import pytest
import trustme

import taskrpc
from taskrpc.cli.robot.server import monitoring
from taskrpc.cli.robot.server.monitoring import Monitoring
from taskrpc.cli.shared.remote import Remote
from taskrpc.course.classroom.class_server import ClassServer
from taskrpc.course.classroom.register import Register
from taskrpc.observe.web import server as web_server
from taskrpc.robot.tasks import MemoryStore, TaskServer
from tests.observe.web.reverse_proxy import reverse_proxy
from tests.robot.tasks.fakes import FullStore, LineRobot

SECRET = "s" * 20
ACCOUNTS = f"""
[accounts.ana]
secret = "{SECRET}"
role = "observe"
[accounts.bo]
secret = "{SECRET}"
revoked = true
[accounts.cy]
secret = "{SECRET}"
expires = {time.time() - 1}
"""


@pytest.fixture
def accounts(tmp_path):
    path = tmp_path / "accounts.toml"
    path.write_text(ACCOUNTS, encoding="utf-8")
    path.chmod(0o600)
    return path


@pytest.fixture
def tls(tmp_path):
    issued = trustme.CA().issue_cert("localhost")
    issued.private_key_pem.write_to_path(tmp_path / "key.pem")
    issued.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
    return taskrpc.Tls(cert=tmp_path / "cert.pem", key=tmp_path / "key.pem")


@pytest.mark.parametrize(
    ("token", "expected"),
    [
        ("the server's own", True),
        (f"ana.{SECRET}", True),
        (f"bo.{SECRET}", False),
        (f"cy.{SECRET}", False),
        (f"nobody.{SECRET}", False),
        (f"ana.{SECRET}x", False),
        ("ana.", False),
        (SECRET, False),
        ("", False),
        ("\udcff", False),
    ],
)
def test_tokens_of_the_server_and_of_its_accounts_are_accepted(accounts, token, expected):
    watch = Monitoring("127.0.0.1:0", Remote(token="the server's own"), str(accounts))
    assert watch.tokens.may_look(token) is expected


@pytest.mark.parametrize("token", [f"{name}.{'x' * 20}" for name in ("ana", "bo", "nobody")])
def test_wrong_token_takes_the_same_comparisons_for_every_account_name(
    accounts, token, monkeypatch
):
    compared = []
    compare = hmac.compare_digest
    monkeypatch.setattr(hmac, "compare_digest", lambda *two: compared.append(two) or compare(*two))
    watch = Monitoring("127.0.0.1:0", Remote(token="the server's own"), str(accounts))
    assert not watch.tokens.may_look(token)
    assert len(compared) == 4


def test_without_accounts_only_the_token_of_the_server_is_accepted(monkeypatch):
    monkeypatch.setenv("TASKRPC_TOKEN", "environment")
    watch = Monitoring("127.0.0.1:0", Remote(), None)
    assert watch.tokens.may_look("environment")
    assert not watch.tokens.may_look("")
    assert not watch.tokens.may_look(f"ana.{SECRET}")


def test_account_removed_from_the_file_is_refused(accounts):
    watch = Monitoring("127.0.0.1:0", Remote(), str(accounts))
    assert watch.tokens.may_look(f"ana.{SECRET}")
    accounts.write_text(ACCOUNTS.replace("ana", "anna"), encoding="utf-8")
    assert not watch.tokens.may_look(f"ana.{SECRET}")


async def test_weak_token_beyond_this_machine_is_refused(tls):
    async with taskrpc.Node("task_server", transport="memory") as node:
        server = TaskServer(node, LineRobot(), FullStore())
        watch = Monitoring("0.0.0.0:0", Remote(tls=tls, token="short"), None)
        with pytest.raises(taskrpc.CannotListen, match="the token has 5 characters"):
            watch.web(server, node)
        Monitoring("0.0.0.0:0", Remote(tls=tls, token=SECRET), None).web(server, node)
        Monitoring("127.0.0.1:0", Remote(token="short"), None).web(server, node)


async def test_missing_token_and_accounts_beyond_this_machine_are_refused(tls):
    async with taskrpc.Node("task_server", transport="memory") as node:
        server = TaskServer(node, LineRobot(), FullStore())
        with pytest.raises(taskrpc.CannotListen, match=r"without a certificate and a token"):
            Monitoring("0.0.0.0:0", Remote(tls=tls), None).web(server, node)


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("origins", "status"), [((), 403), (["http://lab.local:8000"], 101), (["http://x.local"], 403)]
)
async def test_page_of_an_allowed_origin_may_open_a_websocket(origins, status):
    async with taskrpc.Node("task_server", transport="memory") as node:
        server = TaskServer(node, LineRobot(), FullStore())
        web = Monitoring("127.0.0.1:0", Remote(), None, origins).web(server, node)
        async with web, aiohttp.ClientSession() as http:
            try:
                async with http.ws_connect(web.url, origin="http://lab.local:8000"):
                    found = 101
            except aiohttp.WSServerHandshakeError as refused:
                found = refused.status
            assert found == status
            # The pages themselves stay closed to pages of other servers.
            headers = {"Origin": "http://lab.local:8000"}
            async with http.get(f"{web.url}/live", headers=headers) as response:
                assert response.status == 403


@pytest.mark.real_time
async def test_clients_of_rosbridge_are_told_that_the_server_ends():
    async with taskrpc.Node("task_server", transport="memory") as node:
        server = TaskServer(node, LineRobot(), FullStore())
        watch = Monitoring("127.0.0.1:0", Remote(), None)
        async with aiohttp.ClientSession() as http:
            async with watch.serving(watch.web(server, node)) as web:
                socket = await http.ws_connect(web.url)
                end = asyncio.ensure_future(socket.receive())
            message = await asyncio.wait_for(end, 60)
        assert (message.data, message.extra) == (1001, "the server is ending")


@pytest.mark.real_time
async def test_account_with_the_role_observe_sees_the_page_and_cannot_control(
    accounts, monkeypatch
):
    # As from another machine: the server's own user needs no token for looking.
    monkeypatch.setattr(web_server, "is_other_user", lambda peer, local: True)
    token = f"ana.{SECRET}"
    async with taskrpc.Node("task_server", accounts=accounts) as node:
        server = TaskServer(node, LineRobot(), MemoryStore(), join=True)
        await server.start()
        await server.manager.submit("move", "1", 5)
        web = Monitoring("127.0.0.1:0", Remote(), str(accounts)).web(server, node)
        headers = {"Authorization": f"Bearer {token}"}
        async with web, aiohttp.ClientSession(web.url, headers=headers) as http:
            async with http.get("/live") as response:
                hello = await response.content.readuntil(b"\n\n")
                assert response.status == 200
                assert b'"control":false' in hello
            async with http.get("/task/1") as response:
                assert (await response.json())["task_id"] == 1
            for verb in ("pause", "stop", "submit", "cancel"):
                body = {"task_id": 1} if verb == "cancel" else {}
                async with http.post(f"/control/{verb}", json=body) as response:
                    assert response.status == 403
                    problem = (await response.json())["message"]
                    assert "the account ana has observe" in problem
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await http.ws_connect("/")
            assert refused.value.status == 401
            async with http.get("/live", headers={"Authorization": ""}) as response:
                assert response.status == 401
        assert not server.manager.is_paused
        await server.close()


PUBLIC = "https://lab.example"


async def seen_through(proxy, token, host, origin):
    """What the page, a button and the WebSocket get through a proxy, each with its status."""
    headers = {"Host": host} | ({"Authorization": f"Bearer {token}"} if token else {})
    found = []
    async with aiohttp.ClientSession(headers=headers) as http:
        async with http.get(f"http://{proxy}/") as response:
            found.append(response.status)
        async with http.get(f"http://{proxy}/live") as response:
            first = (await response.content.readline()).decode()
            found.append((response.status, first.rstrip() if response.status == 200 else ""))
        own = {"Origin": origin}
        async with http.post(f"http://{proxy}/control/pause", headers=own, json={}) as response:
            found.append(response.status)
        try:
            async with http.ws_connect(f"http://{proxy}/", origin=origin) as socket:
                call = {"op": "call_service", "service": "/robot_task/health", "id": "1"}
                await socket.send_json(call)
                answer = await socket.receive_json(timeout=60)
                found.append((101, answer["values"]["success"]))
        except aiohttp.WSServerHandshakeError as refused:
            found.append((refused.status, False))
    return found


SHOWN = [200, (200, "event: hello"), 200, (101, True)]


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("origins", "token", "host", "expected"),
    [
        ([PUBLIC], "server", "", SHOWN),
        ([PUBLIC], "control", "", SHOWN),
        ([PUBLIC], "view", "", [200, (200, "event: hello"), 401, (401, False)]),
        ([PUBLIC], "", "", [200, (401, ""), 401, (401, False)]),
        ([], "server", "", [421, (421, ""), 421, (421, False)]),
        ([PUBLIC], "server", "replaced", SHOWN),
        ([], "server", "replaced", [200, (200, "event: hello"), 403, (403, False)]),
    ],
)
async def test_page_its_events_its_buttons_and_rosbridge_work_behind_a_proxy(
    origins, token, host, expected
):
    secret = "the token of the server"
    async with taskrpc.Node("task_server") as node:
        server = TaskServer(node, LineRobot(), MemoryStore())
        await server.start()
        watch = Monitoring("127.0.0.1:0", Remote(token=secret), None, origins)
        token = {"server": secret, "": ""}.get(token) or getattr(watch.tokens, token, "")
        async with watch.serving(watch.web(server, node)) as web:
            replaced = web.url.removeprefix("http://") if host else ""
            async with reverse_proxy(web.url, host=replaced) as proxy:
                assert await seen_through(proxy, token, "lab.example", PUBLIC) == expected
        await server.close()


@pytest.mark.real_time
@pytest.mark.parametrize("of_a_class", [True, False])
async def test_page_for_all_addresses_has_the_address_that_laptops_use(
    of_a_class, tls, tmp_path, monkeypatch
):
    monkeypatch.setattr(monitoring, "own_addresses", lambda: ["192.0.2.1", "192.0.2.2"])
    Register(tmp_path / "class").server = ClassServer(("robot.lab", "192.0.2.2"), 7450)
    async with taskrpc.Node("task_server", transport="memory") as node:
        server = TaskServer(node, LineRobot(), MemoryStore())
        watch = Monitoring("0.0.0.0:0", Remote(tls=tls, token=SECRET), None)
        folder = str(tmp_path / "class") if of_a_class else None
        async with watch.serving(watch.web(server, node, folder)) as web:
            port = int(web.url.rpartition(":")[2])
            host = "robot.lab" if of_a_class else "192.0.2.1"
            assert web.url == f"https://{host}:{port}"
            here, found = f"https://127.0.0.1:{port}/", {}
            async with aiohttp.ClientSession() as http:
                for name in (host, "192.0.2.2", "192.0.2.3"):
                    named = {"Host": f"{name}:{port}"}
                    async with http.get(here, headers=named, ssl=False) as response:
                        found[name] = response.status
            assert found == {host: 200, "192.0.2.2": 200, "192.0.2.3": 421}

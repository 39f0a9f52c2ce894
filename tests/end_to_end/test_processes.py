"""Servers in real processes: clients find them; tests kill, restart and stop them."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

import taskrpc
from tests.core.transport.helpers import Add, ask, outcome, until

pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.real_time,
    pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals"),
]

SERVER = """
import asyncio, sys
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")

async def add(request, response):
    if request.b:
        print("running", flush=True)
        await asyncio.sleep(request.b / 1000)
    response.sum = request.a
    return response

async def main():
    async with taskrpc.Node(sys.argv[1]) as node:
        node.create_service(Add, "add", add, concurrency=1000, join="join" in sys.argv)
        print("ready", flush=True)
        await node.spin()
        print("drained", flush=True)

taskrpc.run(main())
"""


@pytest.fixture
def start(tmp_path):
    script = tmp_path / "adder.py"
    script.write_text(SERVER)
    with contextlib.ExitStack() as stack:

        def start(*arguments):
            server = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, script, *(arguments or ["server"])],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                    cwd=tmp_path,
                )
            )
            stack.callback(server.kill)
            assert server.stdout.readline() == "ready\n", server.stderr.read()
            return server

        yield start


@pytest.fixture
async def client():
    async with taskrpc.Node("client") as node:
        yield node.create_client(Add, "add")


async def line(server):
    return await asyncio.to_thread(server.stdout.readline)


async def test_client_finds_a_server_in_another_process_without_configuration(start, client):
    start()
    assert (await client.call(ask(7))).sum == 7


async def test_waiting_client_is_woken_when_a_server_starts(start, client):
    waiting = asyncio.create_task(client.wait_for_service(None))
    await asyncio.to_thread(start)  # the task begins to wait while the process starts
    async with asyncio.timeout(60):
        assert await waiting


async def test_calls_of_a_killed_server_end_at_once_with_unknown_outcome(start, client):
    server = start()
    calls = [client.call_async(ask(n, 60_000), timeout=None) for n in range(100)]
    assert await line(server) == "running\n"
    server.kill()
    async with asyncio.timeout(
        60
    ):  # they have no deadline: only the end of the connection ends them
        errors = await asyncio.gather(*calls, return_exceptions=True)
    assert {type(each) for each in errors} == {taskrpc.OutcomeUnknown}
    assert all("the connection was lost" in str(each) for each in errors)
    assert {each.not_executed for each in errors} == {None}
    assert isinstance(await outcome(client.call(ask(1))), taskrpc.ServiceUnavailable)


async def test_client_finds_a_restarted_server(start, client):
    for n in range(2):
        server = await asyncio.to_thread(start)
        assert await client.wait_for_service(60)
        assert (await client.call(ask(n))).sum == n
        server.kill()
        server.wait(60)
        await until(lambda: not client.service_is_ready())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_calls_in_flight_finish_after_a_stop_signal(start, client, number):
    server = start()
    call = client.call_async(ask(5, 300))
    assert await line(server) == "running\n"
    server.send_signal(number)
    await until(lambda: not client.service_is_ready())
    assert isinstance(await outcome(client.call(ask(1))), taskrpc.ServiceUnavailable)
    assert (await call).sum == 5
    out, errors = await asyncio.to_thread(server.communicate)
    assert (server.returncode, out, errors) == (0, "drained\n", "")


async def test_second_signal_ends_a_draining_server_at_once(start, client):
    server = start()
    call = client.call_async(ask(5, 60_000))
    assert await line(server) == "running\n"
    server.terminate()
    await until(lambda: not client.service_is_ready())  # it drains
    assert server.poll() is None
    server.terminate()
    assert await asyncio.to_thread(server.wait, 60) == 128 + signal.SIGTERM  # 0 if it had drained
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)


async def test_idle_server_ends_within_two_seconds(start, client):
    began = time.perf_counter()
    server = start()
    # On a busy machine, an exit may take as long as the start.
    limit = max(2.0, time.perf_counter() - began)
    await client.call(ask(1))
    began = time.perf_counter()
    server.terminate()
    assert await asyncio.to_thread(server.wait, 60) == 0
    assert time.perf_counter() - began < limit


async def test_calls_move_to_a_second_server_without_errors(start, client):
    first = start("first")
    assert await client.wait_for_service(60)
    start("second", "join")
    calls = []

    async def load():
        while first.poll() is None:
            calls.append(client.call_async(ask(len(calls))))
            await asyncio.sleep(0.0005)  # the pace of the calls

    loading = asyncio.create_task(load())
    await until(lambda: len(calls) >= 100)
    first.terminate()
    async with asyncio.timeout(60):
        await loading
    assert [each.sum for each in await asyncio.gather(*calls)] == list(range(len(calls)))
    assert first.returncode == 0


async def test_second_server_is_refused_with_the_first_servers_details(start, tmp_path):
    first = start("first")
    done = await asyncio.to_thread(
        subprocess.run,
        [sys.executable, tmp_path / "adder.py", "second"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert f"/add is already offered by adder.py (pid {first.pid}, in {tmp_path}, since" in last
    assert f"end it with `taskrpc stop {first.pid}`" in last


FLOODED = """
import asyncio, resource, socket, logging
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")
logging.disable(logging.CRITICAL)

def add(request, response):
    response.sum = request.a + request.b
    return response

async def main():
    async with taskrpc.Node("server", token="s") as server, taskrpc.Node("client") as node:
        server.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        await client.wait_for_service(5)
        host, port = server.address.split(":")
        resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40))
        flood = []
        while True:
            sock = socket.socket()
            flood.append(sock)
            sock.setblocking(False)
            sock.connect_ex((host, int(port)))
            if len(flood) > 10:
                break
        for _ in range(20):
            try:
                flood.append(socket.socket())
            except OSError:
                break
        await asyncio.sleep(0.1)
        print("busy", (await client.call(Add.Request(a=1, b=2))).sum)
        for sock in flood:
            sock.close()
        await asyncio.sleep(1.2)  # asyncio accepts again after a second
        async with taskrpc.Node("late", token="l") as late:
            other = late.create_client(Add, "add")
            print("free", (await other.call(Add.Request(a=3, b=4))).sum)

asyncio.run(main())
"""


async def test_server_out_of_descriptors_continues_and_accepts_again_later(tmp_path):
    script = tmp_path / "flooded.py"
    script.write_text(FLOODED)
    done = await asyncio.to_thread(
        subprocess.run, [sys.executable, script], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("busy 3\nfree 7\n", 0), done.stderr

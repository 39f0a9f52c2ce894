"""`taskrpc ps` and `taskrpc stop` list and end the programs of this user."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from taskrpc.cli.shared.processes import Process, processes
from taskrpc.core.system import signals
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.registry import Registry
from taskrpc.core.wire.messages import ServiceEndpoint

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

ADD = "example_interfaces/srv/AddTwoInts"


def test_ps_prints_script_folder_start_and_services(server, run):
    heading, row = run("ps")[1].splitlines()
    assert heading.split() == ["PID", "SINCE", "DOMAIN", "SCRIPT", "FOLDER", "SERVICES"]
    assert row.startswith(str(server.process.pid))
    assert str(server.folder) in row
    assert row.endswith("/sleep")
    (facts,) = json.loads(run("ps", "--json")[1])
    assert facts["script"] == "adder.py"
    assert facts["folder"] == str(server.folder)
    assert facts["services"] == ["/add_two_ints", "/end", "/fail", "/refuse", "/sleep"]
    assert 0 <= time.time() - facts["since"] < 600


def test_ps_without_programs_prints_an_empty_array(run):
    assert run("ps", "--json") == (0, "[]\n", "")


@pytest.mark.parametrize("name", ["17", "adder", "adder.py", "/other", "other", "/add", "add"])
def test_program_is_selected_by_pid_script_node_or_service(name):
    service = ServiceEndpoint("/add", ADD, "", "/other")
    entry = RegistryEntry(17, "adder.py", "/home", 0.0, nodes=("/other",), services=(service,))
    assert Process(0, (entry,)).is_meant_by(name)
    assert not Process(0, (entry,)).is_meant_by(name + "x")


@pytest.mark.parametrize(
    "name", ["server.py", "server", "08_debugging/server.py", "/home/a/08_debugging/server.py"]
)
def test_script_is_selected_by_the_end_of_its_path(name):
    entry = RegistryEntry(42, "08_debugging/server.py", "/home/a", 0.0)
    assert Process(0, (entry,)).is_meant_by(name)
    assert not Process(0, (entry,)).is_meant_by("erver.py")
    assert not Process(0, (entry,)).is_meant_by(f"b/{name}")


def test_stop_ends_the_only_program(own_server, run):
    assert run("stop") == (0, f"stopped adder.py (pid {own_server.process.pid})\n", "")
    # Windows cannot ask a process to end, it can only end it.
    assert own_server.process.wait(30) == (15 if sys.platform == "win32" else 0)


def test_stop_all_ends_all_programs(own_server, run):
    assert run("stop", "--all")[0] == 0
    assert run("stop", "--all") == (0, "no taskrpc program is running\n", "")


def test_stop_of_an_unknown_name_ends_no_program(server, run):
    code, out, err = run("stop", str(os.getpid()))
    assert (code, out) == (1, "")
    assert f"there are adder.py (pid {server.process.pid})" in err
    assert server.process.poll() is None


@contextlib.contextmanager
def forged_entry(pid):
    """A locked entry of this test's, with the id of another process."""
    with contextlib.closing(Registry(0)) as registry:
        entry = RegistryEntry(pid, "forged.py", "/home", 0.0, nodes=("/forged",))
        registry.publish(TrackedEntry(entry), EntryChange())
        yield


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells which files are open")
@pytest.mark.parametrize("how", [("forged",), ("forged", "--force"), ("--all",)])
def test_a_process_that_another_program_names_is_not_ended(own_server, run, how):
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as foreign:
        with forged_entry(foreign.pid):
            code, out, err = run("stop", *how)
        foreign.communicate(b"\n")
    assert foreign.returncode == 0
    assert (code, out.startswith("stopped adder.py")) == (1, "--all" in how)
    assert err.startswith(f"not ended: forged.py (pid {foreign.pid})\n  hint: ")
    assert "did not write the registry entry; " in err


@pytest.mark.parametrize("pid", [0, -1, -17])
def test_no_group_of_processes_is_ended(run, monkeypatch, pid):
    signalled = []
    monkeypatch.setattr(
        "taskrpc.core.system.signals.end_process", lambda pid, at_once: signalled.append(pid)
    )
    monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 0.0)
    with forged_entry(pid):
        assert run("stop", "forged")[0] == 1
    assert signalled == []


def test_a_program_that_does_not_react_is_reported(server, run, monkeypatch):
    monkeypatch.setattr("taskrpc.core.system.signals.end_process", lambda pid, at_once: None)
    monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 0.1)
    code, _, err = run("stop", "adder")
    assert code == 1
    who = f"adder.py (pid {server.process.pid})"
    assert err.startswith(f"still running after 0.1 s: {who}\n  hint: {who} does not react: ")
    assert "--force ends it at once" in err


SLOW = """
import asyncio, srvgen, taskrpc

async def sleep(request, response):
    print("called", flush=True)
    await asyncio.sleep(60)
    return response

async def main():
    async with taskrpc.Node("slow") as node:
        node.create_service(srvgen.load("std_srvs/srv/Empty"), "sleep", sleep)
        await node.spin()

taskrpc.run(main())
"""


@pytest.mark.skipif(os.name != "posix", reason="Windows cannot ask a process to end")
def test_draining_program_and_hanging_program_are_distinguished(tmp_path, run, monkeypatch):
    monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 1.0)
    (tmp_path / "slow.py").write_text(SLOW, encoding="utf-8")
    call = [sys.executable, "-m", "taskrpc.cli.call", "/sleep", "--timeout", "60"]
    with (
        subprocess.Popen(
            [sys.executable, "slow.py"], cwd=tmp_path, stdout=subprocess.PIPE, text=True
        ) as slow,
        subprocess.Popen(call, stdout=subprocess.DEVNULL),
    ):
        assert slow.stdout.readline() == "called\n"
        code, _, err = run("stop", "slow")
        assert code == 1
        assert f"hint: slow.py (pid {slow.pid}) waits for calls in flight, and then" in err
        code, out, _ = run("ps")
        assert out.splitlines()[1].endswith("  - (ending)")
        (facts,) = json.loads(run("ps", "--json")[1])
        assert facts["state"] == "ending"
        code, out, _ = run("doctor")
        assert (code, "slow.py" in out, "it is ending" in out) == (0, True, True)
        assert run("stop", "--force", "slow")[0] == 0


GOAL = """
import asyncio, signal, srvgen, taskrpc
Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")

async def execute(goal):
    print("runs", flush=True)
    await asyncio.sleep(600)

async def main():
    async with taskrpc.Node("fibber") as node:
        node.create_service(srvgen.load("std_srvs/srv/Empty"), "empty", lambda _, r: r)
        node.create_action_server(Fibonacci, "fibonacci", execute)
        node.create_action_server(Fibonacci, "idle", execute)
        ended = asyncio.Event()
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
        client = node.create_action_client(Fibonacci, "fibonacci")
        await client.wait_for_server()
        await client.send_goal(Fibonacci.Goal())
        await ended.wait()
        await node.drain()

taskrpc.run(main())
"""


@pytest.mark.skipif(os.name != "posix", reason="Windows cannot ask a process to end")
def test_a_program_that_a_goal_holds_is_reported_with_its_action(tmp_path, run, monkeypatch):
    monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 0.5)
    (tmp_path / "fibber.py").write_text(GOAL, encoding="utf-8")
    command = [sys.executable, "fibber.py"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as fibber:
        assert fibber.stdout.readline() == "runs\n"
        code, _, err = run("stop")
        assert run("stop", "--force")[0] == 0
    assert code == 1
    assert f"(pid {fibber.pid}) waits for running goals of /fibonacci; --force does not" in err


HELD = """
import asyncio, signal, threading, time, srvgen, taskrpc

ended = threading.Event()

async def main():
    async with taskrpc.Node("held") as node:
        {create}
        signal.signal(signal.SIGTERM, {handler})
        print("there", flush=True)
        {wait}

threading.Thread(target=time.sleep, args=(600,), daemon={daemon}).start()
taskrpc.run(main())
"""
SERVES = 'node.create_service(srvgen.load("std_srvs/srv/Empty"), "empty", lambda _, r: r)'
PUBLISHES = 'node.create_publisher(srvgen.load("std_msgs/msg/Empty"), "news")'


@contextlib.contextmanager
def held(folder, monkeypatch, handler, wait="time.sleep(600)", *, create=SERVES, leaves=False):
    """A program that does not end; if it `leaves` the registry, `stop` waits for this first."""
    text = HELD.format(create=create, handler=handler, wait=wait, daemon=not leaves)
    (folder / "held.py").write_text(text, encoding="utf-8")
    end_process = signals.end_process

    def end(pid, *, at_once):
        end_process(pid, at_once=at_once)
        while leaves and any(each.pid == pid for each in processes()):
            time.sleep(0.01)

    monkeypatch.setattr("taskrpc.core.system.signals.end_process", end)
    monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 0.1)
    with subprocess.Popen(
        [sys.executable, "held.py"], cwd=folder, stdout=subprocess.PIPE, text=True
    ) as program:
        try:
            assert program.stdout.readline() == "there\n"
            yield program
        finally:
            program.kill()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells which signals are ignored")
def test_a_program_that_ignores_the_signal_is_reported_as_such(tmp_path, run, monkeypatch):
    with held(tmp_path, monkeypatch, "signal.SIG_IGN"):
        assert ") ignores the signal to end (SIGTERM); --force ends it at once" in run("stop")[2]


@pytest.mark.skipif(os.name != "posix", reason="Windows cannot ask a process to end")
def test_a_program_that_a_thread_holds_is_not_called_stopped(tmp_path, run, monkeypatch):
    wait = "await asyncio.to_thread(ended.wait)"
    with held(tmp_path, monkeypatch, "lambda *_: ended.set()", wait, leaves=True) as program:
        code, out, err = run("stop")
        assert (code, out, program.poll()) == (1, "", None)
        assert f"held.py (pid {program.pid}) has destroyed its nodes, but a thread" in err


@pytest.mark.skipif(os.name != "posix", reason="Windows cannot ask a process to end")
@pytest.mark.parametrize("create", [SERVES, PUBLISHES])
def test_a_blocked_program_or_one_with_a_handler_is_not_called_ending(
    tmp_path, run, monkeypatch, create
):
    with held(tmp_path, monkeypatch, "lambda *_: None", create=create):
        assert json.loads(run("ps", "--json")[1])[0]["state"] == "running"
        assert ") does not react: a callback or a loop may block it, or it" in run("stop")[2]


BUSY = """
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("busy")
future = node.create_client(Trigger, "nobody").call_async(Trigger.Request())
print("there", flush=True)
while not future.done():
    pass
"""
"""A frequent mistake. With ROS's own rclpy, SIGTERM does not end this program either."""


@pytest.mark.skipif(os.name != "posix", reason="Windows cannot ask a process to end")
def test_a_busy_loop_is_reported_and_ended_with_force(tmp_path, run, monkeypatch):
    (tmp_path / "busy.py").write_text(BUSY, encoding="utf-8")
    monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 0.1)
    command = [sys.executable, "-m", "taskrpc", "run", "busy.py"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as program:
        try:
            assert program.stdout.readline() == "there\n"
            code, out, err = run("stop")
            assert (code, out, program.poll()) == (1, "", None)
            assert ") does not react: a callback or a loop may block it" in err
            monkeypatch.setattr("taskrpc.cli.network.stop.END_TIMEOUT", 60)
            assert run("stop", "--force")[:2] == (0, f"stopped busy.py (pid {program.pid})\n")
            assert program.wait(60) == -signal.SIGKILL
        finally:
            program.kill()


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_a_program_that_ctrl_z_stopped_is_shown_and_can_be_ended(own_server, run):
    os.kill(own_server.process.pid, signal.SIGSTOP)
    os.waitpid(own_server.process.pid, os.WUNTRACED)  # until it stands
    code, out, _ = run("ps")
    assert (code, out.splitlines()[1].endswith(" (stopped)")) == (0, True)
    assert json.loads(run("ps", "--json")[1])[0]["state"] == "stopped"
    assert run("stop") == (0, f"stopped adder.py (pid {own_server.process.pid})\n", "")

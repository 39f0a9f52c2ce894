"""Promise 28: Ctrl-C, SIGTERM and `taskrpc stop` end a program in any waiting call.

Each program waits in one call, alone or in a loop, as a process of its own. A thread of it tells
when the main thread waits: when it has been outside of the program's own file for a while.
"""

import asyncio
import importlib.util
import os
import random
import signal
import sys
import textwrap
import time
from pathlib import Path

import pytest

from tests.faults.harness import Bug

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no such signal"),
]
BROKEN = ("did not end", "wrong status", "too many lines", "tracebacks")
BOUND, AT_A_TIME = 10.0, 3
SIGNALS = ("SIGINT", "SIGTERM")
HEAD = """
import asyncio, sys, threading, time
import srvgen

def tell(main=threading.main_thread().ident):
    seen = 0
    while seen < 5:
        time.sleep(0.02)
        seen = seen + 1 if sys._current_frames()[main].f_code.co_filename != __file__ else 0
    print("waiting", flush=True)

Trigger = srvgen.load("std_srvs/srv/Trigger")
String = srvgen.load("std_msgs/msg/String")
Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
Goal = Fibonacci.Goal

async def never(*_):
    await asyncio.get_running_loop().create_future()
"""
NATIVE = """
import taskrpc
async def main():
    async with taskrpc.Node("waiter") as node, taskrpc.Node("busy", token="b") as busy:
        client = node.create_client(Trigger, "absent")
        actions = node.create_action_client(Fibonacci, "missing")
        busy.create_service(Trigger, "slow", never)
        busy.create_action_server(Fibonacci, "long", never)
        busy.create_action_server(Fibonacci, "undecided", never, goal=never)
        undecided = node.create_action_client(Fibonacci, "undecided")
        slow = node.create_client(Trigger, "slow")
        long = node.create_action_client(Fibonacci, "long")
        await slow.wait_for_service()
        await long.wait_for_server()
        await undecided.wait_for_server()
        threading.Thread(target=tell, daemon=True).start()
        {line}
taskrpc.run(main())
"""
BLOCKING = """
import taskrpc.sync
busy = taskrpc.sync.Node("busy", token="b").start()  # with connections of its own
with taskrpc.sync.Node("waiter") as node:
    client = node.create_client(Trigger, "absent")
    actions = node.create_action_client(Fibonacci, "missing")
    busy.create_service(Trigger, "slow", never)
    busy.create_action_server(Fibonacci, "long", never)
    busy.create_action_server(Fibonacci, "undecided", never, goal=never)
    undecided = node.create_action_client(Fibonacci, "undecided")
    slow, long = node.create_client(Trigger, "slow"), node.create_action_client(Fibonacci, "long")
    slow.wait_for_service()
    long.wait_for_server()
    undecided.wait_for_server()
    threading.Thread(target=tell, daemon=True).start()
    {line}
"""
RCLPY = """
import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from rclpy.experimental import AsyncNode
from rclpy.task import Future
from rclpy.wait_for_message import wait_for_message
rclpy.init()
node = rclpy.create_node("waiter")
client = node.create_client(Trigger, "absent")
actions = ActionClient(node, Fibonacci, "missing")
other = AsyncNode("other")

async def forever(goal):
    await Future()

def begin_goal():
    ActionServer(node, Fibonacci, "long", forever)
    long = ActionClient(node, Fibonacci, "long")
    long.wait_for_server()
    sent = long.send_goal_async(Goal())
    rclpy.spin_until_future_complete(node, sent)
    return sent.result()

def spin_in_thread():
    threading.Thread(target=rclpy.spin, args=(node,)).start()

pool = MultiThreadedExecutor(2)
pool.add_node(node)
threading.Thread(target=tell, daemon=True).start()
{line}
"""
SERVES_A_GOAL = """node.create_action_server(Fibonacci, 'busy', never)
client = node.create_action_client(Fibonacci, 'busy')
await client.wait_for_server()
await client.send_goal(Goal())
await node.spin()"""
"""A server whose goal would never end."""
IN_ASYNC_NODE = """async def main():
    async with other as node: await {}
asyncio.run(main())"""
ONLY_AT_SIGINT = {
    IN_ASYNC_NODE.format("node.create_client(Trigger, 'absent').call(Trigger.Request())"),
    IN_ASYNC_NODE.format("node.get_clock().sleep(60)"),
}
"""Calls of an AsyncNode that go on at SIGTERM: only its `run` ends with the context."""
IN_THREAD = """def work():
{}
threading.Thread(target=work).start()
{}"""
CALLS = {
    "native": (
        NATIVE,
        "await client.wait_for_service()",
        "while not await client.wait_for_service(timeout=0.05): print('no')",
        "await actions.wait_for_server()",
        "while not await actions.wait_for_server(timeout=0.05): print('no')",
        "await node.spin()",
        "await slow.call(Trigger.Request(), timeout=60)",
        "await undecided.send_goal(Goal(), timeout=None)",
        "await (await long.send_goal(Goal())).result()",
        "async for _ in (await long.send_goal(Goal())).feedback: pass",
        SERVES_A_GOAL,
    ),
    "blocking": (
        BLOCKING,
        "client.wait_for_service()",
        "while not client.wait_for_service(timeout=0.05): print('no')",
        "actions.wait_for_server()",
        "while not actions.wait_for_server(timeout=0.05): print('no')",
        "node.spin()",
        "slow.call(Trigger.Request(), timeout=60)",
        "undecided.send_goal(Goal(), timeout=None)",
        "long.send_goal(Goal()).result()",
        "for _ in long.send_goal(Goal()).feedback: pass",
        SERVES_A_GOAL.replace("await ", ""),
        "client.wait_for_service() # in a thread",
        "while not client.wait_for_service(timeout=0.05): print('no') # in a thread",
        "while not actions.wait_for_server(timeout=0.05): print('no') # in a thread",
        "slow.call(Trigger.Request(), timeout=60) # in a thread",
        "undecided.send_goal(Goal(), timeout=None) # in a thread",
        "long.send_goal(Goal()).result() # in a thread",
    ),
    "rclpy": (
        RCLPY,
        "client.wait_for_service()",
        "while not client.wait_for_service(timeout_sec=0.05): print('no')",
        "actions.wait_for_server()",
        "while not actions.wait_for_server(timeout_sec=0.05): print('no')",
        "client.call(Trigger.Request())",
        "client.call(Trigger.Request(), timeout_sec=60.0)",
        "rclpy.spin(node)",
        "while True: rclpy.spin_once(node, timeout_sec=0.05)",
        "rclpy.spin_until_future_complete(node, Future())",
        "pool.spin()",
        "while True: pool.spin_once(timeout_sec=0.05)",
        "node.get_clock().sleep_for(Duration(seconds=60))",
        "rclpy.spin_until_future_complete(node, actions.send_goal_async(Goal()))",
        "rclpy.spin_until_future_complete(node, begin_goal().get_result_async())",
        "spin_in_thread(); actions.send_goal(Goal())",
        "handle = begin_goal(); spin_in_thread(); handle.get_result()",
        "wait_for_message(String, node, 'silent')",
        "while not wait_for_message(String, node, 'silent', 0.05)[0]: print('no')",
        "rate = node.create_rate(0.01); spin_in_thread(); rate.sleep()",
        "rate = node.create_rate(50); spin_in_thread()\nwhile True: rate.sleep()",
        "asyncio.run(other.run())",
        IN_ASYNC_NODE.format("node.create_client(Trigger, 'absent').wait_for_service()"),
        *sorted(ONLY_AT_SIGINT),
        "client.wait_for_service() # in a thread",
        "while not client.wait_for_service(timeout_sec=0.05): print('no') # in a thread",
        "while not actions.wait_for_server(timeout_sec=0.05): print('no') # in a thread",
        "client.call(Trigger.Request(), timeout_sec=60.0) # in a thread",
        "actions.send_goal(Goal()) # in a thread",
        "wait_for_message(String, node, 'silent') # in a thread",
        "rate = node.create_rate(50)\nwhile True: rate.sleep() # in a thread",
        "node.get_clock().sleep_for(Duration(seconds=60)) # in a thread",
    ),
}
RETURNS_AT_SIGTERM = {
    "pool.spin()",
    "node.get_clock().sleep_for(Duration(seconds=60))",
    "wait_for_message(String, node, 'silent')",
    "asyncio.run(other.run())",
}
"""Calls that return when a signal has shut the context down, as in ROS."""
ROWS = [(api, call, how) for api, (_, *calls) in CALLS.items() for call in calls for how in SIGNALS]
# `taskrpc stop` sends SIGTERM too, so one call of each API shows that it finds the program.
ROWS += [(api, call, "stop") for api, (_, call, *_) in CALLS.items()]
ROWS = [row for row in ROWS if row[1] not in ONLY_AT_SIGINT or row[2] == "SIGINT"]


def waits_again_after_the_shutdown(patch):
    # In a program that `taskrpc run` runs, the module has ROS's name.
    name = "rclpy" if importlib.util.find_spec("rclpy") else "taskrpc.ros.packages.rclpy"
    Client = importlib.import_module(f"{name}.client").Client
    wait = Client.wait_for_service

    def absent(client, timeout_sec=None):
        try:
            return wait(client, timeout_sec)
        except Exception:
            time.sleep(timeout_sec or 0.05)
            return False

    patch(Client, "wait_for_service", absent)


def program(api, call):
    if call.endswith("# in a thread"):
        spin = "rclpy.spin(node)" if api == "rclpy" else "node.spin()"
        call = IN_THREAD.format(textwrap.indent(call, "    "), spin)
    template = CALLS[api][0]
    (line,) = (line for line in template.splitlines() if "{line}" in line)
    call = textwrap.indent(call, line.partition("{")[0])
    return template.replace(line, call)


class Table:
    def __init__(self, folder, counts, bug):
        self.folder, self.counts, self.bug = folder, counts, bug
        self.slots = asyncio.Semaphore(AT_A_TIME)
        root = str(Path(__file__).parents[2])
        self.env = os.environ | {"PYTHONPATH": root, "XDG_RUNTIME_DIR": str(folder)}

    async def check(self, number, api, call, how):
        async with self.slots:
            file = self.folder / f"waiter_{number}_{how}.py"
            plant = f"plant_from({self.bug.place!r})" if self.bug else ""
            planted = f"from tests.faults.harness import plant_from\n{plant}\n" if plant else ""
            file.write_text(planted + HEAD + program(api, call))
            command = ["-m", "taskrpc", "run"] if api == "rclpy" else []
            env = self.env | {"ROS_DOMAIN_ID": str(number)}  # all have the same services
            process = await self.start(*command, str(file), env=env)
            try:
                await self.end(process, api, call, how)
            finally:
                if process.returncode is None:
                    process.kill()
                await process.communicate()

    async def start(self, *arguments, env=None):
        pipe = asyncio.subprocess.PIPE
        return await asyncio.create_subprocess_exec(
            sys.executable, *arguments, stdout=pipe, stderr=pipe, env=env or self.env
        )

    async def end(self, process, api, call, how):
        # Two threads print: what one prints may stand before the end of the other's line.
        while b"waiting" not in (line := await asyncio.wait_for(process.stdout.readline(), 60)):
            if line.strip() not in (b"no", b"") or line == b"":
                process.kill()
                pytest.fail(f"{line!r}: {(await process.stderr.read()).decode()}")
        number = signal.SIGINT if how == "SIGINT" else signal.SIGTERM
        if how == "stop":
            stop = await self.start("-m", "taskrpc", "stop", str(process.pid))
            await stop.communicate()
        else:
            process.send_signal(number)
        try:
            _, err = await asyncio.wait_for(process.communicate(), BOUND)
        except TimeoutError:
            print(f"{api}, {how}: {call}: did not end")
            self.counts["did not end"] += 1
            return
        self.judge(process.returncode, err.decode(), number, api, call)

    def judge(self, status, err, number, api, call):
        expected, row = -number, f"{api}, signal {number}: {call}"
        # `spin` of a node returns at each signal, so that the program ends with 0.
        is_spun = api != "rclpy" and call.endswith(("node.spin()", "# in a thread"))
        if is_spun or (call in RETURNS_AT_SIGTERM and number == signal.SIGTERM):
            expected = 0
        elif api == "rclpy" and number == signal.SIGTERM:
            expected = 1  # as with the real rclpy
        self.counts["ended"] += 1
        self.counts["wrong status"] += status != expected
        self.counts["too many lines"] += len(err.splitlines()) > 3
        self.counts["tracebacks"] += "Traceback" in err
        if status != expected or len(err.splitlines()) > 3 or "Traceback" in err:
            print(f"{row}: {status}, expected {expected}: {err[-600:]}")


@pytest.mark.planted(Bug(waits_again_after_the_shutdown, "did not end"))
async def test_every_waiting_call_ends(tmp_path, counts, seed, request):
    bug = request.node.callspec.params.get("bug")
    jobs = [(number, *row) for number, row in enumerate(ROWS)]
    if bug:  # only the rows that it concerns: each may take all of BOUND
        jobs = [job for job in jobs if job[1] == "rclpy" and "client.wait_for" in job[2]]
    random.Random(seed).shuffle(jobs)
    table = Table(tmp_path, counts, bug)
    await asyncio.gather(*(table.check(*job) for job in jobs))
    counts.check(*BROKEN, happened=("ended",))
    counts.require(ended=len(jobs))

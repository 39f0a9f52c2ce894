"""How a fleet on PostgreSQL scales: submissions, executions, and the time of a failover.

    python -m benchmarks.fleet              # 1, 4 and 16 robots, 1,000 and 10,000 tasks
    python -m benchmarks.fleet --tasks 1000

All servers run in this one process, each with its own connections to a PostgreSQL that the
benchmark starts itself, with its usual durability (fsync on). So the figures contain the work of
all servers' Python code on one core. The robots end each task at once.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import statistics
import subprocess
import sys
import time

from taskrpc.robot.fleet import FleetManager, FleetSettings
from taskrpc.robot.fleet.postgres.store import PostgresStore
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.history import History
from tests.postgres import Cluster, why_missing

HERE = Pose(0.0, 0.0, 0.0)
IN_FLIGHT = 64
"""Submissions that wait at the same time."""


class InstantRobot:
    """Executes every task at once; its plans say one second."""

    speed = 1.0
    task_types = ("move",)

    def plan(self, task_type, target, start):
        return Plan(1.0, HERE)

    def pose(self):
        return HERE

    async def execute(self, task_type, target, report):
        return {}

    def remaining(self):
        return 0.0

    def pause(self):
        pass

    def resume(self):
        pass

    def stop(self):
        pass


async def measure(url, robots, tasks):
    """Return submissions a second, executed tasks a second, and the spread over the robots."""
    managers = []
    for number in range(robots):
        settings = FleetSettings(name=f"robot_{number}", queue_limit=tasks, lease=60.0, settle=0.0)
        store = PostgresStore(url, history=History(count=tasks, recent=tasks))
        managers.append(FleetManager(InstantRobot(), store, settings))
        await managers[-1].start()
    await managers[0].pause()
    waiting = asyncio.Semaphore(IN_FLIGHT)
    times = []

    async def submit(number):
        async with waiting:
            began = time.perf_counter()
            manager = managers[number % robots]
            response = await manager.submit("move", str(number), 1 + number % 10)
            assert response.success, response.message
            times.append(time.perf_counter() - began)

    began = time.perf_counter()
    await asyncio.gather(*(submit(number) for number in range(tasks)))
    submitting = time.perf_counter() - began
    began = time.perf_counter()
    await managers[0].resume()
    state = managers[0].store.state
    while len(state) or state.begun:  # noqa: ASYNC110
        await asyncio.sleep(0.02)
    executing = time.perf_counter() - began
    share = [
        sum(task.robot == manager.name for task in state.tasks.values()) for manager in managers
    ]
    await asyncio.gather(*(manager.close() for manager in managers))
    median = statistics.median(times) * 1000
    return tasks / submitting, median, tasks / executing, min(share), max(share)


def failover(url):
    """Return the seconds from `kill -9` of a server to its task's INTERRUPTED."""
    command = [
        sys.executable,
        "-m",
        "taskrpc.cli.robot.server.command_line",
        "--db",
        url,
        "--robot-name",
    ]
    servers = []
    for name in ("robot_a", "robot_b"):
        server = subprocess.Popen([*command, name], stderr=subprocess.PIPE, text=True)
        while "ready" not in (line := server.stderr.readline()):
            assert line, "the server did not start"
        servers.append(server)

    async def watch():
        store = PostgresStore(url)
        manager = FleetManager(
            InstantRobot(), store, FleetSettings(name="watcher", capabilities="x")
        )
        await manager.start()
        await manager.submit("move", "6.5,5.5", 5)
        while not store.state.begun:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        runner = store.state.tasks[1].robot
        victim = servers[("robot_a", "robot_b").index(runner)]
        os.kill(victim.pid, signal.SIGKILL)
        began = time.perf_counter()
        while store.state.tasks[1].state is not TaskState.INTERRUPTED:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        seconds = time.perf_counter() - began
        await manager.close()
        return seconds

    try:
        return asyncio.run(watch())
    finally:
        for server in servers:
            server.kill()
            server.wait()
            server.stderr.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 4, 16])
    parser.add_argument("--tasks", type=int, nargs="+", default=[1000, 10_000])
    parser.add_argument("--failovers", type=int, default=3)
    options = parser.parse_args()
    if reason := why_missing():
        sys.exit(reason)
    cluster = Cluster()
    try:
        cluster.start()
        print("| robots | tasks | submits/s | a submit (median) | executed/s | share of a robot |")
        print("|---|---|---|---|---|---|")
        for robots in options.robots:
            for tasks in options.tasks:
                submits, median, executed, least, most = asyncio.run(
                    measure(cluster.new_database(), robots, tasks)
                )
                print(
                    f"| {robots} | {tasks:,} | {submits:,.0f} | {median:.1f} ms |"
                    f" {executed:,.0f} | {least:,} to {most:,} |",
                    flush=True,
                )
        found = [failover(cluster.new_database()) for _ in range(options.failovers)]
        if found:
            print(f"\nkill -9 to INTERRUPTED: {', '.join(f'{each:.1f} s' for each in found)}")
    finally:
        cluster.remove()


if __name__ == "__main__":
    main()

"""One table of requests: a server of one robot and a fleet of one robot give the same answers.

Each case is a conversation with a server that starts without tasks: requests and their answers, as
`Conversation.answer` reads and writes them. Where a fleet has a reason to answer otherwise, its
answer and the reason follow; the page of the fleet explains each reason.
"""

import asyncio
import re
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from taskrpc.robot.fleet import MemoryFleet, MemoryFleetStore, rules
from taskrpc.robot.tasks import MemoryStore, SqliteStore
from tests.robot.fleet.conversations import TYPES, answers, fleet_of_one, one_robot

PAGE = Path(__file__).parents[3] / "docs" / "explanation" / "fleet.md"

REASONS = {
    "names": "names the robot of each task",
    "log": "keeps no log of why estimates change",
    "counts": "counts its robots and its running tasks",
    "all": "stops all its robots",
    "by-name": "takes requests for one robot by its name",
}
"""What a fleet does, where its answer differs: the first column of the table in `PAGE`."""


class Line(NamedTuple):
    """A request and its answers."""

    request: str
    one: str
    """The answer of a server of one robot."""
    fleet: str
    reason: str = ""
    """Why a fleet answers otherwise; a key of `REASONS`."""


class Case(NamedTuple):
    """A conversation with a new server."""

    lines: list[Line]
    settings: dict[str, object]

    @classmethod
    def parsed(cls, text, **settings):
        """Return the case of a text: `request => answer`, then perhaps `fleet REASON => answer`.

        A line with a larger indentation continues the line before it.
        """
        lines = []
        for line in re.sub(r"\n {12,}", " ", text).strip().splitlines():
            request, _, answer = line.strip().partition(" => ")
            if request.startswith("fleet "):
                lines[-1] = lines[-1]._replace(fleet=answer, reason=request.removeprefix("fleet "))
            else:
                lines.append(Line(request, answer, answer))
        return cls(lines, settings)


CASES = {
    "submissions": Case.parsed(
        r"""
        health => yes; ready: no tasks in the queue
          fleet counts => yes; ready: no tasks in the queue, 1 robot
        list all => no tasks; 0 queued
        pause => yes; The queue is paused
        pause => yes; The queue is paused
        health => yes; ready: no tasks in the queue, the queue is paused
          fleet counts => yes; ready: no tasks in the queue, 1 robot, the queue is paused
        submit fly dock 5 => no; Invalid task: fly (expected move, scan or report)
        submit '' dock 5 => no; Invalid task: (expected move, scan or report)
        submit 'fly\n' dock 5 => no; Invalid task: fly? (expected move, scan or report)
        submit move moon 5 => no; Invalid target: there is no place 'moon'
        submit move unmapped 5 => no; The robot cannot plan this task: RuntimeError: the map is
            missing
        submit move dock 0 => no; Invalid priority: 0 (expected 1 to 10, 10 runs first)
        submit move dock 11 => no; Invalid priority: 11 (expected 1 to 10, 10 runs first)
        submit move dock -1 => no; Invalid priority: -1 (expected 1 to 10, 10 runs first)
        submit fly moon 0 => no; Invalid task: fly (expected move, scan or report)
        submit move moon 0 => no; Invalid target: there is no place 'moon'
        submit move '' 5 => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit scan hall 1 => yes; Task queued: scan (the queue is paused); task 2; 200 s
        submit report hall 10 => yes; Task queued: report (the queue is paused); task 3; 100 s
        submit move dock 11 => no; Invalid priority: 11 (expected 1 to 10, 10 runs first)
        submit move moon 5 => no; Invalid target: there is no place 'moon'
        submit move dock 5 => no; Queue full (waiting: 3, limit: 3)
        list => 3 QUEUED 100 s, 1 QUEUED 200 s, 2 QUEUED 300 s; 3 queued; paused
        cancel 1 => yes; Task 1 was cancelled
        submit move hall 5 => yes; Task queued: move (the queue is paused); task 4; 200 s
        requeue 1 => no; Queue full (waiting: 3, limit: 3)
        list all => 3 QUEUED 100 s, 4 QUEUED 200 s, 2 QUEUED 300 s, 1 CANCELED 0 s; 3 queued; paused
        """,
        queue_limit=3,
    ),
    "request ids": Case.parsed(
        r"""
        pause => yes; The queue is paused
        submit move dock 5 id=A => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit move dock 5 id=A => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit move hall 5 id=A => RequestIdReused: another request was sent under this request id
        submit move dock 5 id=B => yes; Task queued: move (the queue is paused); task 2; 200 s
        submit move moon 5 id=C => no; Invalid target: there is no place 'moon'
        submit move hall 5 id=C => yes; Task queued: move (the queue is paused); task 3; 300 s
        cancel 1 => yes; Task 1 was cancelled
        submit move dock 5 id=A => yes; Task queued: move (the queue is paused); task 1; 100 s
        restart
        submit move dock 5 id=B => yes; Task queued: move (the queue is paused); task 2; 200 s
        list all => 2 QUEUED 100 s, 3 QUEUED 200 s, 1 CANCELED 0 s; 2 queued; paused
        """,
    ),
    "a share for each account": Case.parsed(
        r"""
        pause => yes; The queue is paused
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 2; 200 s
        submit move dock 5 => no; Share full: ann (waiting: 2, limit for one account: 2)
        submit move dock 0 => no; Invalid priority: 0 (expected 1 to 10, 10 runs first)
        show 1 => yes; 1 QUEUED 100 s, move at dock, priority 5, accepted 100 s, 0%, ann
        cancel 1 => yes; Task 1 was cancelled
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 3; 200 s
        requeue 1 => yes; Task queued: move (the queue is paused); 300 s
        list all => 2 QUEUED 100 s, 3 QUEUED 200 s, 1 QUEUED 300 s; 3 queued; paused
        """,
        share=2,
        has_accounts=True,
    ),
    "unknown tasks": Case.parsed(
        r"""
        show 7 => no; There is no task 7
        watch 7 => no; There is no task 7; no tasks; incomplete
        cancel 7 => no; There is no task 7
        drop 7 => no; There is no task 7
        requeue 7 => no; There is no task 7
        requeue 7 resume => no; There is no task 7
        reprioritise 7 3 => no; There is no task 7
        reprioritise 7 0 => no; Invalid priority: 0 (expected 1 to 10, 10 runs first)
        show 0 => no; There is no task 0
        watch 0 => yes; no tasks; incomplete
        cancel 0 => no; There is no task 0
        drop 0 => no; There is no task 0
        requeue 0 => no; There is no task 0
        show -1 => no; There is no task -1
        cancel -1 => no; There is no task -1
        """,
    ),
    "queued tasks": Case.parsed(
        r"""
        pause => yes; The queue is paused
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 2; 200 s
        submit move dock 8 => yes; Task queued: move (the queue is paused); task 3; 100 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 4; 400 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 5; 500 s
        show 2 => yes; 2 QUEUED 300 s, move at dock, priority 5, accepted 200 s, 0%, /client
        robot 2 => none
          fleet names => r1
        changes 2 => 100 s: task 3, priority 8, went ahead
          fleet log => none
        watch 2 => yes; 2 QUEUED 300 s; paused
        reprioritise 2 9 => yes; Task 2 has priority 9; 100 s
        reprioritise 2 9 => yes; Task 2 has priority 9; 100 s
        reprioritise 2 0 => no; Invalid priority: 0 (expected 1 to 10, 10 runs first)
        reprioritise 1 11 => no; Invalid priority: 11 (expected 1 to 10, 10 runs first)
        list => 2 QUEUED 100 s, 3 QUEUED 200 s, 1 QUEUED 300 s, 4 QUEUED 400 s, 5 QUEUED 500 s; 5
            queued; paused
        requeue 2 => yes; Task 2 is queued already; 100 s
        requeue 2 resume => yes; Task 2 is queued already; 100 s
        cancel 1 => yes; Task 1 was cancelled
        cancel 1 => yes; Task 1 is cancelled already
        drop 1 => yes; Task 1 is dropped already
        reprioritise 1 3 => no; Task 1 is CANCELED: only a queued task can be moved
        drop 4 => yes; Task 4 was cancelled
        drop 4 => yes; Task 4 is dropped already
        cancel 4 => yes; Task 4 is cancelled already
        requeue 4 => yes; Task queued: move (the queue is paused); 400 s
        requeue 4 => yes; Task 4 is queued already; 400 s
        requeue 1 resume => no; Task 1 is CANCELED: only an interrupted task can be resumed; taskrpc
            task requeue 1 runs it again
        show 1 => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client, ended,
            cancelled by /client
        show 4 => yes; 4 QUEUED 400 s, move at dock, priority 5, accepted 400 s, 0%, /client
        list all => 2 QUEUED 100 s, 3 QUEUED 200 s, 5 QUEUED 300 s, 4 QUEUED 400 s, 1 CANCELED 0 s;
            4 queued; paused
        health => yes; ready: 4 tasks in the queue, the queue is paused
          fleet counts => yes; ready: 4 tasks in the queue, 1 robot, the queue is paused
        """,
    ),
    "a running task": Case.parsed(
        r"""
        submit move dock 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        submit move hall 5 => yes; Task queued: move; task 2; 200 s
        show 1 => yes; 1 RUNNING 100 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun
        robot 1 => none
          fleet names => r1
        show 2 => yes; 2 QUEUED 200 s, move at hall, priority 5, accepted 200 s, 0%, /client
        list => 1 RUNNING 100 s, 2 QUEUED 200 s; 1 queued
        health => yes; ready: 1 task in the queue, task 1 is running
          fleet counts => yes; ready: 1 task in the queue, 1 task is running, 1 robot
        watch 1 => yes; 1 RUNNING 100 s
        drop 1 => no; Task 1 is RUNNING: only a queued or interrupted task can be dropped
        reprioritise 1 3 => no; Task 1 is RUNNING: only a queued task can be moved
        requeue 1 => no; Task 1 is RUNNING: only an interrupted, failed or cancelled task can be
            queued again
        requeue 1 resume => no; Task 1 is RUNNING: only an interrupted, failed or cancelled task can
            be queued again
        pause => yes; The queue is paused
        show 1 => yes; 1 PAUSED 100 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun
        drop 1 => no; Task 1 is PAUSED: only a queued or interrupted task can be dropped
        reprioritise 1 3 => no; Task 1 is PAUSED: only a queued task can be moved
        requeue 1 => no; Task 1 is PAUSED: only an interrupted, failed or cancelled task can be
            queued again
        pause => yes; The queue is paused
        list => 1 PAUSED 100 s, 2 QUEUED 200 s; 1 queued; paused
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 3; 300 s
        resume => yes; The queue is resumed
        show 1 => yes; 1 RUNNING 100 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun
        resume => yes; The queue is resumed
        cancel 1 => yes; Task 1 was cancelled
        cancel 1 => yes; Task 1 is cancelled already
        drop 1 => yes; Task 1 is dropped already
        show 1 => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun,
            ended, cancelled by /client
        robot 1 => none
          fleet names => r1
        changes 1 => -100 s: task 1 was cancelled
          fleet log => -100 s: the fleet's plan has changed
        until 2 RUNNING
        pause => yes; The queue is paused
        cancel 2 => yes; Task 2 was cancelled
        show 2 => yes; 2 CANCELED 0 s, move at hall, priority 5, accepted 200 s, 0%, /client, begun,
            ended, cancelled by /client
        list all => 3 QUEUED 100 s, 2 CANCELED 0 s, 1 CANCELED 0 s; 1 queued; paused
        """,
    ),
    "a robot that halts late": Case.parsed(
        r"""
        submit move stubborn 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        cancel 1 => yes; Task 1 is being cancelled
        show 1 => yes; 1 CANCELING 100 s, move at stubborn, priority 5, accepted 100 s, 0%, /client,
            begun
        cancel 1 => yes; Task 1 is being cancelled
        drop 1 => no; Task 1 is CANCELING: only a queued or interrupted task can be dropped
        reprioritise 1 3 => no; Task 1 is CANCELING: only a queued task can be moved
        requeue 1 => no; Task 1 is CANCELING: only an interrupted, failed or cancelled task can be
            queued again
        list => 1 CANCELING 100 s; 0 queued
        stop => yes; The robot is stopped and the queue is paused; task 1 was cancelled (taskrpc
            task requeue 1 runs it again)
          fleet all => yes; The robots are stopped and the queue is paused; task 1 was cancelled
            (taskrpc task requeue 1 runs it again)
        until 1 CANCELED
        show 1 => yes; 1 CANCELED 0 s, move at stubborn, priority 5, accepted 100 s, 0%, /client,
            begun, ended, cancelled by /client
        list all => 1 CANCELED 0 s; 0 queued; paused
        """,
    ),
    "ended tasks": Case.parsed(
        r"""
        submit move done 5 => yes; Task queued: move; task 1; 100 s
        until 1 SUCCEEDED
        submit move fails 5 => yes; Task queued: move; task 2; 100 s
        until 2 FAILED
        submit move dock 7 => yes; Task queued: move; task 3; 100 s
        until 3 RUNNING
        submit move hall 5 => yes; Task queued: move; task 4; 200 s
        restart
        until 4 RUNNING
        pause => yes; The queue is paused
        list all => 4 PAUSED 100 s, 3 INTERRUPTED 0 s, 2 FAILED 0 s, 1 SUCCEEDED 0 s; 0 queued;
            paused
        show 1 => yes; 1 SUCCEEDED 0 s, move at done, priority 5, accepted 100 s, 100%, /client,
            begun, ended, {"x":1.0}
        changes 1 => -100 s: task 1 took less time than planned
          fleet log => -100 s: the fleet's plan has changed
        show 2 => yes; 2 FAILED 0 s, move at fails, priority 5, accepted 100 s, 0%, /client, begun,
            ended, RuntimeError: a wheel is stuck
        show 3 => yes; 3 INTERRUPTED 0 s, move at dock, priority 7, accepted 100 s, 0%, /client,
            begun, ended, the server ended while it ran
        robot 3 => none
          fleet names => r1
        watch 3 => yes; 3 INTERRUPTED 0 s; paused
        cancel 1 => no; Task 1 is SUCCEEDED: cannot be cancelled any more
        cancel 2 => no; Task 2 is FAILED: cannot be cancelled any more
        cancel 3 => no; Task 3 is INTERRUPTED: cannot be cancelled any more
        drop 1 => no; Task 1 is SUCCEEDED: only a queued or interrupted task can be dropped
        drop 2 => no; Task 2 is FAILED: only a queued or interrupted task can be dropped
        reprioritise 1 3 => no; Task 1 is SUCCEEDED: only a queued task can be moved
        reprioritise 2 3 => no; Task 2 is FAILED: only a queued task can be moved
        reprioritise 3 3 => no; Task 3 is INTERRUPTED: only a queued task can be moved
        requeue 1 => no; Task 1 is SUCCEEDED: only an interrupted, failed or cancelled task can be
            queued again
        requeue 1 resume => no; Task 1 is SUCCEEDED: only an interrupted, failed or cancelled task
            can be queued again
        requeue 2 resume => no; Task 2 is FAILED: only an interrupted task can be resumed; taskrpc
            task requeue 2 runs it again
        requeue 2 => yes; Task queued: move (the queue is paused); 200 s
        show 2 => yes; 2 QUEUED 200 s, move at fails, priority 5, accepted 200 s, 0%, /client
        requeue 3 resume => yes; Task queued: move (the queue is paused); 200 s
        show 3 => yes; 3 QUEUED 200 s, move at dock, priority 7, accepted 200 s, 0%, /client
        requeue 3 resume => yes; Task 3 is queued already; 200 s
        list all => 4 PAUSED 100 s, 3 QUEUED 200 s, 2 QUEUED 300 s, 1 SUCCEEDED 0 s; 2 queued;
            paused
        health => yes; ready: 2 tasks in the queue, task 4 is running, the queue is paused
          fleet counts => yes; ready: 2 tasks in the queue, 1 task is running, 1 robot, the queue is
            paused
        """,
    ),
    "an interrupted task": Case.parsed(
        r"""
        submit move dock 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        pause => yes; The queue is paused
        restart
        health => yes; ready: no tasks in the queue, the queue is paused, 1 interrupted task waits
            for a decision (taskrpc task list --all)
          fleet counts => yes; ready: no tasks in the queue, 1 robot, the queue is paused, 1
            interrupted task waits for a decision (taskrpc task list --all)
        list all => 1 INTERRUPTED 0 s; 0 queued; paused
        drop 1 => yes; Task 1 was dropped
        drop 1 => yes; Task 1 is dropped already
        cancel 1 => yes; Task 1 is cancelled already
        show 1 => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun,
            ended, dropped by /client
        requeue 1 resume => no; Task 1 is CANCELED: only an interrupted task can be resumed; taskrpc
            task requeue 1 runs it again
        requeue 1 => yes; Task queued: move (the queue is paused); 100 s
        submit move hall 5 => yes; Task queued: move (the queue is paused); task 2; 200 s
        list => 1 QUEUED 100 s, 2 QUEUED 200 s; 2 queued; paused
        """,
    ),
    "pause, resume and stop": Case.parsed(
        r"""
        resume => yes; The queue is resumed
        stop => yes; The robot is stopped and the queue is paused
          fleet all => yes; The robots are stopped and the queue is paused
        stop => yes; The robot is stopped and the queue is paused
          fleet all => yes; The robots are stopped and the queue is paused
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 1; 100 s
        list => 1 QUEUED 100 s; 1 queued; paused
        resume => yes; The queue is resumed
        until 1 RUNNING
        stop => yes; The robot is stopped and the queue is paused; task 1 was cancelled (taskrpc
            task requeue 1 runs it again)
          fleet all => yes; The robots are stopped and the queue is paused; task 1 was cancelled
            (taskrpc task requeue 1 runs it again)
        show 1 => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun,
            ended, the robot was stopped by /client
          fleet all => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client,
            begun, ended, the robots were stopped by /client
        list all => 1 CANCELED 0 s; 0 queued; paused
        pause => yes; The queue is paused
        cancel 1 => yes; Task 1 is cancelled already
        requeue 1 => yes; Task queued: move (the queue is paused); 100 s
        resume => yes; The queue is resumed
        until 1 RUNNING
        pause => yes; The queue is paused
        stop => yes; The robot is stopped and the queue is paused; task 1 was cancelled (taskrpc
            task requeue 1 runs it again)
          fleet all => yes; The robots are stopped and the queue is paused; task 1 was cancelled
            (taskrpc task requeue 1 runs it again)
        show 1 => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client, begun,
            ended, the robot was stopped by /client
          fleet all => yes; 1 CANCELED 0 s, move at dock, priority 5, accepted 100 s, 0%, /client,
            begun, ended, the robots were stopped by /client
        """,
    ),
    "robots by name": Case.parsed(
        r"""
        pause 'robot=r9\n' => no; There is no robot 'r9?': this server drives one robot without a
            name and belongs to no fleet; leave the robot's name out
          fleet by-name => no; There is no robot 'r9?' in the fleet (expected one of: r1)
        resume robot=r9 => no; There is no robot 'r9': this server drives one robot without a name
            and belongs to no fleet; leave the robot's name out
          fleet by-name => no; There is no robot 'r9' in the fleet (expected one of: r1)
        stop robot=r9 => no; There is no robot 'r9': this server drives one robot without a name and
            belongs to no fleet; leave the robot's name out
          fleet by-name => no; There is no robot 'r9' in the fleet (expected one of: r1)
        submit move dock 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        pause robot=r1 => no; There is no robot 'r1': this server drives one robot without a name
            and belongs to no fleet; leave the robot's name out
          fleet by-name => yes; r1 is paused; the other robots continue
        resume robot=r1 => no; There is no robot 'r1': this server drives one robot without a name
            and belongs to no fleet; leave the robot's name out
          fleet by-name => yes; r1 is resumed
        stop robot=r1 => no; There is no robot 'r1': this server drives one robot without a name and
            belongs to no fleet; leave the robot's name out
          fleet by-name => yes; r1 is stopped and paused; the other robots continue; task 1 was
            cancelled (taskrpc task requeue 1 runs it again)
        """,
    ),
    "a robot that cannot pause": Case.parsed(
        r"""
        submit move jammed 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        pause => no; The queue is paused, but the robot failed: RuntimeError: the brake is jammed
        show 1 => yes; 1 RUNNING 100 s, move at jammed, priority 5, accepted 100 s, 0%, /client,
            begun
        resume => yes; The queue is resumed
        stop => yes; The robot is stopped and the queue is paused; task 1 was cancelled (taskrpc
            task requeue 1 runs it again)
          fleet all => yes; The robots are stopped and the queue is paused; task 1 was cancelled
            (taskrpc task requeue 1 runs it again)
        show 1 => yes; 1 CANCELED 0 s, move at jammed, priority 5, accepted 100 s, 0%, /client,
            begun, ended, the robot was stopped by /client
          fleet all => yes; 1 CANCELED 0 s, move at jammed, priority 5, accepted 100 s, 0%, /client,
            begun, ended, the robots were stopped by /client
        """,
    ),
    "a robot that cannot continue": Case.parsed(
        r"""
        submit move flat 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        pause => yes; The queue is paused
        resume => no; The queue is resumed, but the robot failed: RuntimeError: the battery is flat
        show 1 => yes; 1 PAUSED 100 s, move at flat, priority 5, accepted 100 s, 0%, /client, begun
        """,
    ),
    "a robot that cannot stop": Case.parsed(
        r"""
        submit move runaway 5 => yes; Task queued: move; task 1; 100 s
        until 1 RUNNING
        stop => no; The queue is paused, but the robot failed: RuntimeError: no contact
        show 1 => yes; 1 CANCELED 0 s, move at runaway, priority 5, accepted 100 s, 0%, /client,
            begun, ended, the robot was stopped by /client
          fleet all => yes; 1 CANCELED 0 s, move at runaway, priority 5, accepted 100 s, 0%,
            /client, begun, ended, the robots were stopped by /client
        list all => 1 CANCELED 0 s; 0 queued; paused
        """,
    ),
    "pages": Case.parsed(
        r"""
        pause => yes; The queue is paused
        submit move dock 2 => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 2; 100 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 3; 200 s
        cancel 2 => yes; Task 2 was cancelled
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 4; 200 s
        cancel 4 => yes; Task 4 was cancelled
        list limit=1 => 3 QUEUED 100 s; next page w-5:3; 2 queued; paused
        list limit=1 page=last => 1 QUEUED 200 s; 2 queued; paused
        list limit=1 all => 3 QUEUED 100 s; next page w-5:3; 2 queued; paused
        list limit=2 all page=last => 1 QUEUED 200 s, 4 CANCELED 0 s; next page e:4; 2 queued;
            paused
        list limit=2 all page=last => 2 CANCELED 0 s; 2 queued; paused
        list page=garbage => INVALID_ARGUMENT: page: expected `next_page` of an earlier response,
            got 'garbage'
        list page=w-5:0 => 3 QUEUED 100 s, 1 QUEUED 200 s; 2 queued; paused
        list limit=1000 => 3 QUEUED 100 s, 1 QUEUED 200 s; 2 queued; paused
        """,
    ),
    "watching": Case.parsed(
        r"""
        pause => yes; The queue is paused
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 1; 100 s
        submit move dock 5 => yes; Task queued: move (the queue is paused); task 2; 200 s
        watch 0 => yes; no tasks; incomplete; paused
        watch 0 revision=last timeout=0.01 => yes; no tasks; paused
        cancel 1 => yes; Task 1 was cancelled
        watch 0 revision=last timeout=1.0 => yes; 1 CANCELED 0 s; paused
        watch 0 revision=last timeout=0.01 => yes; no tasks; paused
        reprioritise 2 9 => yes; Task 2 has priority 9; 100 s
        watch 1 revision=last timeout=0.01 => yes; no tasks; paused
        reprioritise 2 8 => yes; Task 2 has priority 8; 100 s
        watch 2 revision=last timeout=1.0 => yes; 2 QUEUED 100 s; paused
        resume => yes; The queue is resumed
        until 2 RUNNING
        watch 0 revision=last timeout=1.0 => yes; 2 RUNNING 100 s
        watch 2 => yes; 2 RUNNING 100 s
        """,
    ),
}


async def check(make, case, server):
    """Compare a server's answers to the requests of a case with those of `one` or `fleet`."""
    requests = [line.request for line in case.lines]
    found = await answers(make, requests, **case.settings)
    expected = [getattr(line, server) for line in case.lines]
    # With the requests, so that a failure says to which request the answer differs.
    assert list(zip(requests, found, strict=True)) == list(zip(requests, expected, strict=True))


def memory_fleet():
    loop = asyncio.get_running_loop()
    database = MemoryFleet(lambda: 1000.0 + loop.time())
    return fleet_of_one(lambda: MemoryFleetStore(database))


@pytest.mark.parametrize("name", CASES)
async def test_one_robot_with_a_store_in_memory_gives_the_answers_of_the_table(name):
    store = MemoryStore()
    await check(one_robot(lambda: store), CASES[name], "one")


@pytest.mark.parametrize("name", CASES)
async def test_one_robot_with_sqlite_gives_the_answers_of_the_table(name, tmp_path):
    await check(one_robot(lambda: SqliteStore(tmp_path / "tasks.db")), CASES[name], "one")


@pytest.mark.parametrize("name", CASES)
async def test_fleet_in_memory_gives_the_answers_of_the_table(name):
    await check(memory_fleet(), CASES[name], "fleet")


@pytest.mark.postgres
@pytest.mark.real_time
@pytest.mark.parametrize("name", CASES)
async def test_fleet_in_postgresql_gives_the_answers_of_the_table(name, postgres_url):
    store = pytest.importorskip("taskrpc.robot.fleet.postgres.store").PostgresStore
    await check(fleet_of_one(lambda: store(postgres_url)), CASES[name], "fleet")


async def test_second_success_for_a_cancelled_task_is_found(monkeypatch):
    original = rules.carry_out

    def carry_out(state, now, decision, estimated):
        response = original(state, now, decision, estimated)
        message = response.message.replace("is cancelled already", "was cancelled")
        return msgspec.structs.replace(response, message=message)

    monkeypatch.setattr(rules, "carry_out", carry_out)
    with pytest.raises(AssertionError, match="cancel 1"):
        await check(memory_fleet(), CASES["queued tasks"], "fleet")


async def test_listed_difference_that_has_disappeared_is_found():
    listed = Case.parsed("pause => yes; The queue is paused\n fleet all => yes; Nothing is paused")
    with pytest.raises(AssertionError, match="Nothing is paused"):
        await check(memory_fleet(), listed, "fleet")


def test_page_of_the_fleet_explains_each_reason_of_a_difference():
    differing = [line for case in CASES.values() for line in case.lines if line.reason]
    assert {line.reason for line in differing} == set(REASONS)
    assert all(line.one != line.fleet for line in differing)
    _, _, section = PAGE.read_text(encoding="utf-8").partition("## A fleet of one robot")
    explained = re.findall(r"^\| (?!a fleet |-)([^|]+) \| [^|]+ \|$", section, re.MULTILINE)
    assert sorted(explained) == sorted(REASONS.values())


def test_table_has_requests_of_each_service():
    verbs = [line.request.split()[0] for case in CASES.values() for line in case.lines]
    requests = [verb for verb in verbs if verb not in ("until", "restart")]
    assert len(requests) > 200
    assert set(TYPES) <= set(requests)

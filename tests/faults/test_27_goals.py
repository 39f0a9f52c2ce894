"""Promise 27: a goal runs at most once, ends in one state, and its client learns which.

One server with an action, several clients; all in memory, on virtual time, from one seed. The
server and the clients are killed and restarted, connections are cut or silent, responses are lost,
clients read slowly, repeat their requests and cancel. One more test does this with real processes.
"""

import asyncio
import collections
import contextlib
import random

import pytest

import srvgen
import taskrpc
from taskrpc.actions.client import ActionClient
from taskrpc.actions.goal_handle import Feedback
from taskrpc.actions.server import ActionServer
from taskrpc.actions.states import GoalState
from taskrpc.testing import CallFaults, FaultyNetwork
from tests.core.transport.helpers import outcome
from tests.faults.harness import Bug, read_nothing
from tests.faults.programs import kill
from tests.faults.proxy import CUT, Faults, Proxy

pytestmark = pytest.mark.faults

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
CLIENTS, GOALS, CONCURRENCY = 4, 30, 8
SECONDS = 40.0
"""For how long faults happen."""
PATIENCE = 300.0
"""Seconds without faults after which a goal without an outcome will never have one."""
REFUSED, ABORTS, RAISES = 3, 4, 5
"""The goals whose number has this remainder, divided by 10, are rejected, abort or raise."""
BROKEN = (
    "ran twice",
    "ran although rejected",
    "told that it did not run, but it did",
    "wrong outcome",
    "turned after its end",
    "cancelled after its end",
    "feedback out of order",
    "feedback of another goal",
    "no outcome",
    "left over",
)
FAULTS = (
    "servers killed",
    "clients killed",
    "cuts",
    "silences",
    "lost responses",
    "stopped reading",
    "requests repeated",
)
OUTCOMES = ("succeeded", "canceled", "aborted", "rejected", "told unknown", "feedback dropped")


# Planted bugs


def runs_a_repeated_goal_again(patch):
    send = ActionServer._send_goal

    async def forget_first(self, request, response):
        record = self._ledger.find(bytes(request.goal_id.uuid))
        if record is not None and record.state.is_ended:
            self._ledger._goals.pop(record.goal_id)
            self._ledger._kept.pop(record.goal_id)
        return await send(self, request, response)

    patch(ActionServer, "_send_goal", forget_first)


def cancels_goals_that_have_ended(patch):
    cancel = ActionServer._cancel_goals

    async def turn(self, request, response):
        record = self._ledger.find(bytes(request.goal_info.goal_id.uuid))
        if record is not None and record.state is GoalState.SUCCEEDED:
            record.state = GoalState.CANCELED
        return await cancel(self, request, response)

    patch(ActionServer, "_cancel_goals", turn)


def agrees_to_cancel_what_has_ended(patch):
    cancel = ActionServer._cancel_goals

    async def agree(self, request, response):
        response = await cancel(self, request, response)
        if response.return_code:
            response.return_code = 0
            response.goals_canceling = [request.goal_info]
        return response

    patch(ActionServer, "_cancel_goals", agree)


def sends_only_some_results(patch):
    reply = ActionServer._reply

    def forget(self, call, record):
        if record.goal_id[-1] % 2:
            reply(self, call, record)

    patch(ActionServer, "_reply", forget)


def never_asks_again_for_a_result(patch):
    patch(ActionClient, "_expect_result", lambda self, handle: None)


def reports_each_end_as_success(patch):
    reply = ActionServer._reply

    def succeed(self, call, record):
        if record.state is GoalState.CANCELED:
            call.reply(self._messages.get_result.Response(status=GoalState.SUCCEEDED))
        else:
            reply(self, call, record)

    patch(ActionServer, "_reply", succeed)


def delivers_the_newest_feedback_first(patch):
    def arrived(self, feedback):
        self._waiting.appendleft(feedback)
        self._changed.set()

    patch(Feedback, "_arrived", arrived)


def gives_each_feedback_to_all_goals(patch):
    def on_feedback(self, message):
        for handle in self._handles.values():
            handle.feedback._arrived(message.feedback)

    patch(ActionClient, "_on_feedback", on_feedback)


def waits_for_the_result_of_a_dead_server(patch):
    fetch = ActionClient._call_for_result

    async def wait(self, handle):
        try:
            return await fetch(self, handle)
        except taskrpc.OutcomeUnknown:
            return await asyncio.Event().wait()

    patch(ActionClient, "_call_for_result", wait)


def keeps_goals_that_have_ended(patch):
    patch(ActionClient, "_forget_goal", lambda self, handle: handle.feedback._end())


# The programs


def key(number):
    return f"{number + 1:032x}"


def state_of(got):
    """The state that an outcome of `result()` reports; None for an unknown one."""
    if isinstance(got, Fibonacci.Result):
        return GoalState.SUCCEEDED
    if isinstance(got, taskrpc.GoalCanceled):
        return GoalState.CANCELED
    return GoalState.ABORTED if isinstance(got, taskrpc.GoalAborted) else None


def life_of(got):
    """The life of the server in which a goal ended; 0 for a goal that never began."""
    if isinstance(got, Fibonacci.Result):
        return got.sequence[0] if got.sequence else 0
    if (result := got.result) is not None:
        return life_of(result)
    return int(str(got).partition("on purpose in life ")[2] or 0)


class Robot:
    """The program with the action, and the record of what it did. Each start is a new life."""

    def __init__(self, network, counts, chance):
        self.life = 0
        self.runs = collections.Counter()
        self.ends = {}
        """The state in which a goal ended, by life and number."""
        self.cancelled = set()
        """The goals that a client has cancelled."""
        self.server = self.node = None
        self._network, self._counts, self._chance = network, counts, chance

    async def begin(self):
        self.life += 1
        self._faults = CallFaults("lose-response:0.05")
        self.node = taskrpc.Node(
            "robot", transport="memory", listen="robot", faults=self._faults, token="t"
        )
        await self.node.start()
        self.server = self.node.create_action_server(
            Fibonacci,
            "walk",
            lambda goal, life=self.life: self.execute(goal, life),
            goal=lambda request: request.order % 10 != REFUSED,
            cancel=lambda goal: self._chance.random() < 0.8,
            concurrency=CONCURRENCY,
        )

    async def die(self):
        self._counts["servers killed"] += 1
        self._network.crash("robot")
        await self.end()

    async def end(self):
        # A killed program does nothing more, so its callbacks are in no record.
        self._counts["lost responses"] += sum(self._faults.happened.values())
        life, self.life = self.life, -1
        await self.node.destroy()
        self.life = life

    async def execute(self, goal, life):
        number = goal.request.order
        self.runs[life, number] += 1
        self._counts["runs"] += 1
        for step in range(self._chance.choice((0, 5, 40, 40))):
            goal.publish_feedback(Fibonacci.Feedback(sequence=[life, number, step]))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._chance.uniform(0.0, 0.1)):
                    await goal.wait_for_cancel()
        value = Fibonacci.Result(sequence=[life, number])
        if life != self.life:
            raise asyncio.CancelledError
        # Some goals end as they would have ended without the cancellation.
        if goal.is_cancel_requested and self._chance.random() < 0.8:
            self.ends[life, number] = GoalState.CANCELED
            return goal.canceled(value)
        if number % 10 in (ABORTS, RAISES):
            self.ends[life, number] = GoalState.ABORTED
            if number % 10 == RAISES:
                raise taskrpc.HandlerError("ABORTED", f"on purpose in life {life}")
            return goal.abort(value)
        self.ends[life, number] = GoalState.SUCCEEDED
        return value

    def lives_of(self, number):
        """The lives in which a goal began."""
        return [life for life, ran in self.runs if ran == number]


class Caller:
    """A program that sends goals and checks what it learns about them."""

    def __init__(self, number, network, counts, chance, robot):
        self.program = f"caller{number}"
        self._numbers = range(number * GOALS, (number + 1) * GOALS)
        self._network, self._counts, self._chance = network, counts, chance
        self._robot = robot
        self._in_doubt = set()
        """Goals of which a request may have arrived without a response."""
        self._jobs = {}
        """The task that cares for each goal."""

    async def begin(self):
        self.node = taskrpc.Node(self.program, transport="memory", listen=self.program, token="t")
        await self.node.start()
        self.client = self.node.create_action_client(Fibonacci, "walk")

    async def work(self):
        """Send all goals, at random instants."""
        for number in self._numbers:
            self._care(number)
            await asyncio.sleep(self._chance.uniform(0, 3 * SECONDS / GOALS))

    def _care(self, number):
        self._jobs[number] = asyncio.ensure_future(self._one_goal(number))

    async def suffer(self):
        """Have a fault now and then."""
        loop = asyncio.get_running_loop()
        ends = loop.time() + SECONDS
        while loop.time() < ends:
            await asyncio.sleep(self._chance.uniform(0.5, 4.0))
            await self._chance.choice(
                (self._cut, self._cut, self._silence, self._pause, self._die)
            )()

    async def _cut(self):
        self._network.cut(self.program, "robot")

    async def _silence(self):
        self._network.partition(self.program, "robot")
        await asyncio.sleep(self._chance.uniform(0.1, 12.0))
        self._network.heal()

    async def _pause(self):
        await read_nothing(self.node, self._counts, self._chance.uniform(0.2, 2.0))

    async def _die(self):
        """Be killed, start again, and repeat the requests of all goals without an outcome."""
        self._counts["clients killed"] += 1
        again = [number for number, job in self._jobs.items() if not job.done()]
        self._in_doubt.update(again)
        for number in again:
            self._jobs[number].cancel()
        self._network.crash(self.program)
        await self.node.destroy()
        await self.begin()
        for number in again:
            self._counts["requests repeated"] += 1
            self._care(number)

    async def _one_goal(self, number):
        handle = await self._send(number)
        if handle is None:
            return
        reading = asyncio.ensure_future(self._read(handle, number))
        cancelling = asyncio.ensure_future(self._cancel(handle, number))
        try:
            got = await outcome(handle.result())
            self._note(number, got)
            await reading
            if state_of(got) is not None:
                await self._look_again(number, handle, got)
        finally:
            for task in (reading, cancelling):
                task.cancel()

    async def _send(self, number):
        robot, client = self._robot, self.client
        for _ in range(8):
            times = self._chance.choice((1, 1, 1, 2))
            self._counts["requests repeated"] += times - 1
            sent = [
                client.send_goal(*self._goal(number), goal_id=key(number)) for _ in range(times)
            ]
            got, *_ = await asyncio.gather(*map(outcome, sent))
            if isinstance(got, taskrpc.GoalRejected):
                self._counts["rejected"] += 1
                is_refused = number % 10 == REFUSED
                self._counts["ran although rejected"] += bool(robot.lives_of(number)) and is_refused
                if is_refused:
                    return None
            elif not isinstance(got, taskrpc.TaskRpcError):
                return got
            elif got.not_executed is not True:
                self._in_doubt.add(number)
            elif number not in self._in_doubt and robot.lives_of(number):
                self._counts["told that it did not run, but it did"] += 1
            self._counts["not accepted"] += 1
            await asyncio.sleep(self._chance.uniform(0.1, 4.0))
        return None

    def _goal(self, number):
        return Fibonacci.Goal(order=number), 5.0

    async def _read(self, handle, number):
        """Check the feedback of a goal; some goals are read slowly."""
        last = (0, 0)
        pause = self._chance.choice((0.0, 0.0, 0.3))
        async for message in handle.feedback:
            life, of, step = message.sequence
            self._counts["feedback"] += 1
            self._counts["feedback of another goal"] += of != number
            if of == number:
                self._counts["feedback out of order"] += (life, step + 1) <= last
                last = (life, step + 1)
            await asyncio.sleep(pause)
        self._counts["feedback dropped"] += handle.feedback.dropped

    async def _cancel(self, handle, number):
        if self._chance.random() < 0.6:
            return
        await asyncio.sleep(self._chance.uniform(0, 2.0))
        self._robot.cancelled.add(number)
        times = self._chance.choice((1, 1, 10))
        await asyncio.gather(*(outcome(handle.cancel(timeout=5)) for _ in range(times)))

    def _note(self, number, got):
        """Compare the outcome that a client got with what the servers did."""
        robot, state = self._robot, state_of(got)
        if state is None:
            self._counts["told unknown"] += 1
            self._counts["wrong outcome"] += not isinstance(got, taskrpc.OutcomeUnknown)
            return
        self._counts[str(state).lower()] += 1
        ends = [robot.ends.get((life, number)) for life in robot.lives_of(number)]
        is_true = state in ends
        if state is GoalState.CANCELED:
            never_began = robot.life not in robot.lives_of(number) or not ends
            is_true = number in robot.cancelled and (is_true or never_began)
        elif state is GoalState.SUCCEEDED:
            is_true = robot.ends.get((life_of(got), number)) is state
        self._counts["wrong outcome"] += not is_true

    async def _look_again(self, number, handle, got):
        """After its end a goal cannot be cancelled, and a repeated request finds the same end."""
        asked = await asyncio.gather(*(outcome(handle.cancel(timeout=5)) for _ in range(2)))
        again = await outcome(self.client.send_goal(*self._goal(number), goal_id=key(number)))
        if isinstance(again, taskrpc.TaskRpcError):
            return
        second = await outcome(again.result(timeout=60))
        # A later life of the server does not know the goal.
        if state_of(second) is None or life_of(got) != self._robot.life:
            return
        self._counts["looked at again"] += 1
        self._counts["cancelled after its end"] += True in asked
        is_same = state_of(second) is state_of(got) and life_of(second) == life_of(got)
        self._counts["turned after its end"] += not is_same

    async def finish(self):
        """Without faults, each goal must have an outcome."""
        _, late = await asyncio.wait(self._jobs.values(), timeout=PATIENCE)
        self._counts["no outcome"] += len(late)
        for job in late:
            job.cancel()
        for each in await asyncio.gather(*self._jobs.values(), return_exceptions=True):
            if isinstance(each, Exception):
                raise each
        client = self.client
        self._counts["left over"] += await left_over(
            lambda: (client._handles, client._tasks, client._queue)
        )


@pytest.mark.planted(
    Bug(runs_a_repeated_goal_again, "ran twice"),
    Bug(cancels_goals_that_have_ended, "turned after its end"),
    Bug(agrees_to_cancel_what_has_ended, "cancelled after its end"),
    Bug(sends_only_some_results, "no outcome"),
    Bug(reports_each_end_as_success, "wrong outcome"),
    Bug(delivers_the_newest_feedback_first, "feedback out of order"),
    Bug(gives_each_feedback_to_all_goals, "feedback of another goal"),
    Bug(waits_for_the_result_of_a_dead_server, "no outcome"),
    Bug(keeps_goals_that_have_ended, "left over"),
)
async def test_goals_run_at_most_once_and_clients_learn_how_they_ended(counts, seed, large):
    for round_ in range(200 if large else 2):
        await rehearse(counts, random.Random(f"{seed} {round_}"), round_)
        counts["rounds"] += 1
    counts.check(*BROKEN, happened=(*FAULTS, *OUTCOMES, "looked at again", "feedback"))


async def rehearse(counts, chance, number):
    with FaultyNetwork(seed=number, delay=(0.0, 0.02), pieces=3000) as network:
        robot = Robot(network, counts, chance)
        callers = [Caller(each, network, counts, chance, robot) for each in range(CLIENTS)]
        for program in (robot, *callers):
            await program.begin()
        deaths = asyncio.ensure_future(kill_sometimes(robot, chance))
        parts = [part for caller in callers for part in (caller.work(), caller.suffer())]
        await asyncio.gather(*parts)
        await deaths
        network.heal()
        await asyncio.gather(*(caller.finish() for caller in callers))
        counts["ran twice"] += sum(count > 1 for count in robot.runs.values())
        server = robot.server
        counts["left over"] += await left_over(
            lambda: (
                *(server._goals, server._jobs, server._results),
                *(server._waiting, server._deciding),
            )
        )
        counts["cuts"] += network.happened["cuts"]
        counts["silences"] += network.happened["silences"]
        for caller in callers:
            await caller.node.destroy()
        await robot.end()


async def left_over(collections):
    """Wait until collections are empty, which may take time; returns the number of elements."""
    count = lambda: sum(map(len, collections()))  # noqa: E731
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(PATIENCE):
            while count():
                await asyncio.sleep(1)
    return count()


async def kill_sometimes(robot, chance):
    for _ in range(3):
        await asyncio.sleep(chance.uniform(0.3, 0.5) * SECONDS)
        await robot.die()
        await asyncio.sleep(chance.choice((0.0, 0.5, 3.0)))
        await robot.begin()


@pytest.mark.planted(Bug(never_asks_again_for_a_result, "no outcome"))
async def test_clients_ask_again_for_each_result_whose_response_was_lost(counts, large):
    goals = 400 if large else 40
    faults = CallFaults(f"lose-response:first={goals},service=/walk/_action/get_result")
    robot = taskrpc.Node("robot", transport="memory", listen="robot", faults=faults)
    async with robot, taskrpc.Node("caller", transport="memory") as node:
        robot.create_action_server(
            Fibonacci,
            "walk",
            lambda goal: Fibonacci.Result(sequence=[goal.request.order]),
            concurrency=goals,
        )
        client = node.create_action_client(Fibonacci, "walk")
        handles = [await client.send_goal(Fibonacci.Goal(order=each)) for each in range(goals)]
        jobs = [asyncio.ensure_future(handle.result()) for handle in handles]
        done, late = await asyncio.wait(jobs, timeout=PATIENCE)
        counts["no outcome"] += len(late)
        counts["succeeded"] += len(done)
        found = {job.result().sequence[0] for job in done}
        counts["wrong outcome"] += len(found ^ set(range(goals))) - len(late)
        for job in late:
            job.cancel()
    counts["lost responses"] += sum(faults.happened.values())
    counts.check(*BROKEN, happened=("lost responses", "succeeded"))


# Real processes

WALKER = """\
import asyncio, sys
import srvgen, taskrpc
Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
life, address, record = sys.argv[1:]

async def walk(goal):
    number = goal.request.order
    with open(record, "a") as lines:
        lines.write(f"{life} {number}\\n")
    for step in range(3):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[int(life), number, step]))
        await asyncio.sleep(0.02)
    return Fibonacci.Result(sequence=[int(life), number])

async def main():
    async with taskrpc.Node("walker", listen=address, token="t") as node:
        node.create_action_server(Fibonacci, "walk", walk, concurrency=16)
        print("ready", node.address, flush=True)
        await node.spin()

taskrpc.run(main())
"""
"""Offers `walk`: appends a line to a file for each goal that it executes."""


@pytest.mark.real_time
@pytest.mark.planted(Bug(runs_a_repeated_goal_again, "ran twice"))
async def test_goals_of_killed_processes_run_at_most_once(counts, seed, large, programs, tmp_path):
    record = tmp_path / "record"
    address, number = "127.0.0.1:0", 0
    chance = random.Random(seed)
    for life in range(1, 51 if large else 4):
        program = await programs.start(WALKER, str(life), address, str(record), name="walker.py")
        address = programs.said.split()[-1]
        faults = Faults(chance, counts, kinds=(CUT,), share=0.9, skip=2000, reach=15_000)
        async with (
            Proxy(address, faults) as proxy,
            taskrpc.Node("caller", peers=[proxy.address], token="t") as node,
        ):
            client = node.create_action_client(Fibonacci, "walk")
            numbers = range(number, number + 60)
            number += 60
            jobs = [asyncio.ensure_future(walk_once(client, each, counts)) for each in numbers]
            await asyncio.sleep(chance.uniform(0.1, 0.6))
            counts["servers killed"] += 1
            await kill(program)
            _, late = await asyncio.wait(jobs, timeout=30)
            counts["no outcome"] += len(late)
            for job in jobs:
                job.cancel()
            await asyncio.gather(*jobs, return_exceptions=True)
    ran = collections.Counter(record.read_text().splitlines())
    counts["runs"] += ran.total()
    counts["ran twice"] += sum(times > 1 for times in ran.values())
    happened = ("runs", "servers killed", CUT, "succeeded", "told unknown", "requests repeated")
    counts.check(*BROKEN, happened=happened)


async def walk_once(client, number, counts):
    """Send a goal, wait for its result, and send it once more; note the outcomes."""
    for _ in range(2):
        try:
            goal = Fibonacci.Goal(order=number)
            handle = await client.send_goal(goal, timeout=3, goal_id=key(number))
            result = await handle.result(timeout=20)
        except taskrpc.TaskRpcError as error:
            counts["told unknown" if error.not_executed is not True else "told not run"] += 1
            counts["no outcome"] += isinstance(error, taskrpc.DeadlineExceeded)
            return
        counts["succeeded"] += 1
        counts["wrong outcome"] += result.sequence[1] != number
        counts["requests repeated"] += 1
        last = -1
        async for message in handle.feedback:
            counts["feedback of another goal"] += message.sequence[1] != number
            counts["feedback out of order"] += message.sequence[2] <= last
            last = message.sequence[2]

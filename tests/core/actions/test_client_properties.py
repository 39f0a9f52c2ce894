"""Any order of goals, repetitions, cancellations, lost messages and time: each goal runs once.

A program is a list of steps. It runs in virtual time with a server that keeps results for a short
time, over a network that loses responses and connections.
"""

import asyncio
import contextlib
from collections import Counter

from hypothesis import example, given, settings
from hypothesis import strategies as st

import taskrpc
from taskrpc import GoalState
from taskrpc.actions.messages import ActionMessages, states_in
from taskrpc.actions.states import ACTIVE, ENDED
from taskrpc.testing import CallFaults, FaultyNetwork, VirtualTimeLoop
from tests.core.actions.helpers import Fibonacci, order, programs, result
from tests.core.transport.helpers import outcome

CONCURRENCY, KEEP, MOST_SECONDS, MOST_STEPS = 2, 5.0, 6, 12
REFUSED, RAISES = 1, 2
"""The orders that are rejected, and whose callback raises."""

numbers = st.integers(0, MOST_STEPS)
steps = st.one_of(
    st.tuples(st.just("send"), numbers, st.integers(0, MOST_SECONDS)),
    st.tuples(st.just("cancel"), numbers, st.just(0)),
    st.tuples(st.just("wait"), st.just(0), st.integers(0, 40)),
    st.tuples(st.just("cut"), st.just(0), st.just(0)),
)
faults = st.sampled_from(
    ["cut-connection:0.3", "lose-response:0.2", "delay-response:0.5s,0.5", "busy:0.2"]
)


def key(number):
    return f"{number + 1:032x}"


class Run:
    """One program, what the server did, and what the clients learned."""

    def __init__(self):
        self.begun = Counter()
        self.running = 0
        self.ended = {}
        self.cancelled = set()
        self.handles = {}
        self.seconds = {}
        """The order of each goal id; a repetition has the same one."""
        self.seen = {}
        """The last state of each goal in the status messages."""
        self.tasks = []

    def accept(self, goal):
        return goal.order != REFUSED

    async def execute(self, goal):
        self.begun[goal.goal_id] += 1
        self.running += 1
        assert self.running <= CONCURRENCY
        assert not goal.state.is_ended
        try:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(goal.request.order):
                    await goal.wait_for_cancel()
        finally:
            self.running -= 1
        if goal.request.order == RAISES:
            raise taskrpc.HandlerError("ABORTED", "on purpose")
        value = result(goal.request.order)
        self.ended[goal.goal_id] = goal.is_cancel_requested
        return goal.canceled(value) if goal.is_cancel_requested else value

    def on_status(self, message):
        for goal_id, state in states_in(message).items():
            before = self.seen.get(goal_id, GoalState.ACCEPTED)
            assert state >= before or (before in ENDED and state is before), (before, state)
            assert before in ACTIVE or state is before
            self.seen[goal_id] = state

    async def send(self, client, number, seconds):
        seconds = self.seconds.setdefault(key(number), seconds)
        sent = client.send_goal(order(seconds), timeout=60, goal_id=key(number))
        outcome_of_sending = await outcome(sent)
        if isinstance(outcome_of_sending, taskrpc.TaskRpcError):
            is_rejected = isinstance(outcome_of_sending, taskrpc.GoalRejected)
            assert is_rejected <= (seconds == REFUSED), outcome_of_sending
        else:
            assert seconds != REFUSED
            self.handles.setdefault(key(number), []).append(outcome_of_sending)

    async def cancel(self, client, number):
        for handle in self.handles.get(key(number), ())[-1:]:
            self.cancelled.add(handle.goal_id)
            with contextlib.suppress(taskrpc.TaskRpcError):
                if await handle.cancel(timeout=30):
                    assert handle.state is not GoalState.ACCEPTED or not self.begun[handle.goal_id]

    async def step(self, client, network, kind, number, amount):
        if kind == "send":
            self.tasks.append(asyncio.ensure_future(self.send(client, number, amount)))
            await asyncio.sleep(0.01)
        elif kind == "cancel":
            self.tasks.append(asyncio.ensure_future(self.cancel(client, number)))
        elif kind == "wait":
            await asyncio.sleep(amount / 10)
        else:
            network.cut("client", "server")

    async def main(self, program, fault):
        injected = CallFaults(fault)
        options = {"goal": self.accept, "concurrency": CONCURRENCY, "result_timeout": KEEP}
        with FaultyNetwork() as network:
            async with (
                programs(self.execute, node={"faults": injected}, **options) as (node, _, client),
            ):
                status = ActionMessages(Fibonacci).status
                topic = "/fibonacci/_action/status"
                node.create_subscription(status, topic, self.on_status, 1000)
                for each in program:
                    await self.step(client, network, *each)
                await asyncio.gather(*self.tasks)
                for goal_id, handles in self.handles.items():
                    for handle in handles:
                        await self.check(goal_id, handle)
        assert all(count == 1 for count in self.begun.values()), self.begun
        assert not self.running

    async def check(self, goal_id, handle):
        """The client's outcome is the server's, or it is unknown."""
        seconds = self.seconds[goal_id]
        value = await outcome(handle.result(timeout=600))
        if isinstance(value, taskrpc.GoalCanceled):
            assert goal_id in self.cancelled
            assert self.ended.get(goal_id, True)
        elif isinstance(value, taskrpc.GoalAborted):
            assert (seconds, str(value)) == (RAISES, "on purpose")
        elif isinstance(value, taskrpc.OutcomeUnknown):  # it has expired, or was lost too often
            assert handle.state is GoalState.UNKNOWN
        else:
            assert list(value.sequence) == [seconds]
            assert self.begun[goal_id] == 1
            assert self.ended[goal_id] is False
        # Its feedback has ended, too.
        async with asyncio.timeout(10):
            assert [each async for each in handle.feedback] == []


@settings(max_examples=60)
@given(st.lists(steps, max_size=MOST_STEPS), faults)
@example([("send", 0, 3), ("send", 0, 3), ("cancel", 0, 0), ("cut", 0, 0)], "cut-connection:0.3")
@example([("send", 1, 6), ("send", 2, 6), ("send", 3, 6), ("wait", 0, 5), ("cancel", 3, 0)], "busy")
@example([("send", 0, 0), ("wait", 0, 40), ("wait", 0, 40), ("send", 0, 0)], "lose-response:0.2")
@example([("cut", 0, 0), ("send", 0, 0), ("send", 1, 0), ("send", 1, 0)], "cut-connection:0.3")
def test_each_goal_runs_at_most_once_and_its_client_learns_what_the_server_did(program, fault):
    # After its expiry, an id may be used again: then it is another goal.
    program = [each for n, each in enumerate(program) if not _is_late_repetition(program, n)]
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(Run().main(program, fault))


def _is_late_repetition(program, place):
    """Whether a goal id is sent again when the server may have forgotten it."""
    kind, number, _ = program[place]
    first = next(n for n, each in enumerate(program) if each[:2] == (kind, number))
    waited = sum(each[2] / 10 for each in program[first:place] if each[0] == "wait")
    return kind == "send" and waited > KEEP / 2

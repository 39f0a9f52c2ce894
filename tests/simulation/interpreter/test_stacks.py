"""Stacks take turns, wait, and let the clock jump; no process needs to be prepared for this."""

import contextlib

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from taskrpc.simulation.interpreter import stacks as module
from taskrpc.simulation.interpreter.stacks import STEP, Killed, Stacks, Stop
from taskrpc.simulation.interpreter.threads import Handle
from taskrpc.spi import current_program
from tests.properties import examples


def first(_ready):
    return 0


def never():
    return False


@pytest.fixture
def stacks():
    made = Stacks()
    yield made
    made.reset()


def start(stacks, run, program=""):
    token, handle = current_program.set(program), Handle()
    try:
        stacks.start(run, handle)
    finally:
        current_program.reset(token)
    return handle


def stack_of(stacks, handle):
    return stacks.all[handle.ident]


def run(stacks, until=100.0, choose=first, watch=never):
    return stacks.run(until, choose, watch)


def test_stack_runs_until_it_waits(stacks):
    seen = []

    def work(name):
        seen.append(f"{name} begins")
        stacks.sleep(1)
        seen.append(f"{name} ends")

    start(stacks, lambda: work("a"))
    start(stacks, lambda: work("b"))
    assert run(stacks) is Stop.IDLE
    assert seen == ["a begins", "b begins", "a ends", "b ends"]


def test_clock_jumps_to_the_next_timer(stacks):
    seen = []

    def work(seconds):
        stacks.sleep(seconds)
        seen.append((seconds, stacks.now))

    for seconds in 30, 10, 20:
        start(stacks, lambda seconds=seconds: work(seconds))
    run(stacks)
    assert [seconds for seconds, _ in seen] == [10, 20, 30]
    assert all(now == pytest.approx(seconds, abs=100 * STEP) for seconds, now in seen)


def test_each_step_takes_virtual_time(stacks):
    times = []

    def work():
        for _ in range(3):
            times.append(stacks.now)
            stacks.sleep(0)

    start(stacks, work)
    run(stacks)
    assert times == sorted(set(times))


def test_slow_program_needs_more_time_for_a_step(stacks):
    times = {"slow": [], "fast": []}

    def work(name):
        for _ in range(3):
            times[name].append(stacks.now)
            stacks.sleep(0)

    stacks.slowness["slow"] = 1.0
    start(stacks, lambda: work("slow"), "slow")
    run(stacks)
    start(stacks, lambda: work("fast"), "fast")
    run(stacks)
    slow, fast = times["slow"], times["fast"]
    assert slow[-1] - slow[0] == 2.0
    assert fast[-1] - fast[0] == pytest.approx(2 * STEP)


def test_choice_decides_which_ready_stack_runs(stacks):
    seen = []
    for name in "abc":
        start(stacks, lambda name=name: seen.append(name))
    run(stacks, choose=lambda ready: len(ready) - 1)
    assert seen == ["c", "b", "a"]


def test_run_stops_at_its_time_and_continues(stacks):
    seen = []

    def work():
        stacks.sleep(10)
        seen.append("woken")

    start(stacks, work)
    assert run(stacks, until=5) is Stop.TIME
    assert (stacks.now, seen) == (5, [])
    assert run(stacks, until=20) is Stop.IDLE
    assert seen == ["woken"]


def test_watcher_stops_the_run_after_the_step_of_a_stack(stacks):
    seen = []
    watched = []

    def watch():
        watched.append(list(seen))
        return True

    start(stacks, lambda: seen.append(1), "a")
    start(stacks, lambda: seen.append(2), "b")
    assert run(stacks, watch=watch) is Stop.ASKED
    assert watched == [[1]]


def test_wait_says_whether_it_was_granted(stacks):
    waiters, results = [], []
    start(stacks, lambda: results.append(stacks.wait(waiters.append, 5.0)))
    start(stacks, lambda: results.append(stacks.wait(waiters.append, 10.0)))
    run(stacks, until=1.0)
    assert waiters[0].wake(granted=True)
    assert not waiters[0].wake(granted=True)
    run(stacks)
    assert results == [True, False]
    assert not waiters[1].wake(granted=True)


def test_wait_without_time_gives_the_turn_to_others(stacks):
    seen = []

    def work(name):
        for number in range(2):
            seen.append(f"{name}{number}")
            assert not stacks.wait(lambda _: None, 0)

    for name in "ab":
        start(stacks, lambda name=name: work(name))
    run(stacks)
    assert seen == ["a0", "b0", "a1", "b1"]


def test_endless_wait_of_all_stacks_leaves_the_run_idle(stacks):
    start(stacks, lambda: stacks.wait(lambda _: None, None))
    assert run(stacks) is Stop.IDLE


def test_code_outside_of_the_stacks_cannot_wait(stacks):
    with pytest.raises(RuntimeError, match="wants to wait"):
        stacks.sleep(1)


def test_killed_stack_never_runs_again_and_its_timer_does_not_move_the_clock(stacks):
    seen = []

    def work():
        stacks.sleep(1)
        seen.append("early")
        stacks.sleep(50)
        seen.append("late")

    handle = start(stacks, work)
    run(stacks, until=2)
    stacks.kill(stack_of(stacks, handle))
    assert run(stacks) is Stop.IDLE
    assert (stacks.now, seen) == (2, ["early"])


def test_killed_stack_that_was_ready_does_not_run(stacks):
    seen = []
    handle = start(stacks, lambda: seen.append(1))
    stacks.kill(stack_of(stacks, handle))
    assert run(stacks) is Stop.IDLE
    assert seen == []


def test_stacks_of_a_program_are_the_living_ones(stacks):
    for program in "aab":
        start(stacks, lambda: stacks.sleep(1), program)
    all_of_a = stacks.of("a")
    assert [each.program for each in all_of_a] == ["a", "a"]
    stacks.kill(all_of_a[0])
    assert stacks.of("a") == all_of_a[1:]


def test_reset_ends_stacks_at_their_waits(stacks):
    seen = []

    def work():
        try:
            stacks.sleep(50)
        except Killed:
            seen.append("caught")
            stacks.sleep(1)  # ends at once, too
            seen.append("never")
        finally:
            seen.append("finally")

    start(stacks, work)
    run(stacks, until=2)
    stacks.reset()
    assert seen == ["caught", "finally"]
    assert (stacks.now, stacks.steps, stacks.all) == (0.0, 0, {})


def test_reset_ends_a_stack_that_catches_everything_again_and_again(stacks):
    def work():
        while True:
            with contextlib.suppress(BaseException):
                stacks.sleep(50)

    start(stacks, work)
    run(stacks, until=2)
    stacks.reset()
    assert run(stacks) is Stop.IDLE


def test_new_run_gives_the_same_numbers(stacks):
    idents = []
    for _ in range(2):
        start(stacks, lambda: idents.append(stacks.get_ident()))
        run(stacks)
        stacks.reset()
    assert idents[0] == idents[1] != stacks.get_ident()


def test_handle_ends_with_its_stack(stacks):
    handle = start(stacks, lambda: stacks.sleep(1))
    assert not handle.is_done()
    run(stacks)
    assert handle.is_done()


def test_stack_keeps_the_context_of_its_starter(stacks):
    seen = []

    def inner():
        seen.append(current_program.get())

    def outer():
        start_here = Handle()
        stacks.start(inner, start_here)

    start(stacks, outer, "robot#1")
    run(stacks)
    assert seen == ["robot#1"]


def test_each_stack_is_announced_before_it_runs(stacks):
    seen = []
    stacks.enter = lambda stack: seen.append(f"enter {stack.program}")
    start(stacks, lambda: seen.append("a"), "a")
    start(stacks, lambda: seen.append("b"), "b")
    run(stacks)
    assert seen == ["enter a", "a", "enter b", "b"]


waits = st.lists(st.sampled_from([0.0, 0.0, 0.0, STEP, 3 * STEP, 0.5, 1.0]), max_size=12)


@given(st.lists(waits, min_size=1, max_size=4), st.sampled_from([STEP, 0.01]))
@settings(max_examples=examples(500), deadline=None)
@example([[0.0] * 3, [0.0] * 3, [0.5, 0.0, 0.0, 0.0]], 0.01)
def test_a_step_without_a_switch_changes_nothing_of_a_run(programs, slowness):
    def played(is_quiet):
        stacks, seen = Stacks(), []
        stacks.slowness["0"] = slowness

        def work(number):
            for each in programs[number]:
                stacks.sleep(each)
                seen.append((number, stacks.now, stacks.steps))

        try:
            for number in range(len(programs)):
                start(stacks, lambda number=number: work(number), str(number))
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(module, "_RESTLESS", 6)  # a stack that polls soon counts as restless
                stops = [
                    stacks.run(until, lambda ready: 7 * stacks.steps % len(ready), never, is_quiet)
                    for until in (0.025, 0.515, 30.0)
                ]
            return seen, stops, stacks.now, stacks.steps
        finally:
            stacks.reset()

    assert played(lambda: True) == played(never)


def test_a_stack_takes_steps_without_a_switch_only_while_nothing_is_to_be_seen(stacks, monkeypatch):
    switches = []
    switch = Stacks._switch
    monkeypatch.setattr(
        Stacks, "_switch", lambda self, stack: switches.append(stack) or switch(self, stack)
    )
    start(stacks, lambda: [stacks.sleep(0) for _ in range(10)])
    stacks.run(100.0, first, never, lambda: len(switches) == 2)
    assert len(switches) == 2
    assert stacks.steps == 11

"""An eagerly started coroutine has the same task, timeouts and cancellation as any other."""

import asyncio
import contextvars
from unittest import mock

import pytest

from taskrpc.core.callinfo import answering
from taskrpc.core.execution.eager_start import EagerStarter

variable = contextvars.ContextVar("variable", default="unset")


@pytest.fixture
def held():
    return []


@pytest.fixture
async def starter(held):
    """A starter; the tests call it outside a task, like a callback of the event loop."""
    made = EagerStarter(asyncio.get_running_loop(), held.append)
    yield made
    made.close()
    await asyncio.sleep(0)


async def outside(function, *arguments):
    """Call a function as the event loop calls callbacks."""
    loop = asyncio.get_running_loop()
    done = loop.create_future()

    def call():
        try:
            done.set_result(("returned", function(*arguments)))
        except StopIteration as finished:
            done.set_result(("finished", finished.value))
        except BaseException as error:
            done.set_result(("raised", error))

    loop.call_soon(call)
    return await done


async def start(starter, coroutine):
    return await outside(starter.start, coroutine)


async def test_coroutine_that_does_not_suspend_creates_no_task(starter):
    async def quick():
        return 7

    assert await start(starter, quick()) == ("finished", 7)
    tasks = asyncio.all_tasks()
    for _ in range(5):
        assert await start(starter, quick()) == ("finished", 7)
    assert asyncio.all_tasks() == tasks


async def test_coroutine_that_suspends_continues_in_a_task(starter):
    async def slow():
        await asyncio.sleep(1)
        return 7

    what, task = await start(starter, slow())
    assert what == "returned"
    assert await task == 7


async def test_coroutine_that_yields_without_a_future_continues(starter):
    async def yielding():
        for _ in range(3):
            await asyncio.sleep(0)
        return 7

    _, task = await start(starter, yielding())
    assert await task == 7


async def test_several_coroutines_may_await_one_future_in_their_first_step(starter):
    """Callbacks that begin in the same iteration of the loop may await the same future."""
    shared = asyncio.get_running_loop().create_future()

    async def wait():
        return await shared

    coroutines = [wait() for _ in range(3)]
    what, tasks = await outside(lambda: [starter.start(each) for each in coroutines])
    assert what == "returned"
    await asyncio.sleep(1)
    shared.set_result(7)
    assert await asyncio.gather(*tasks) == [7, 7, 7]


async def test_the_current_task_is_the_same_before_and_after_suspending(starter):
    async def who():
        before = asyncio.current_task()
        await asyncio.sleep(0)
        return before, asyncio.current_task()

    _, task = await start(starter, who())
    assert await task == (task, task)


async def test_outside_a_step_no_task_is_current(starter):
    async def quick():
        return asyncio.current_task()

    _, spare = await start(starter, quick())
    assert spare is not None
    assert await outside(asyncio.current_task) == ("returned", None)


@pytest.mark.parametrize("delay", [0, 0.5])
async def test_timeout_that_begins_in_the_first_step_ends_the_wait(starter, delay):
    async def patient():
        try:
            async with asyncio.timeout(delay):
                await asyncio.sleep(10)
        except TimeoutError:
            return "late"

    began = asyncio.get_running_loop().time()
    _, task = await start(starter, patient())
    assert await task == "late"
    assert asyncio.get_running_loop().time() - began == pytest.approx(delay)


async def test_unused_timeout_has_no_effect(starter):
    async def quick():
        async with asyncio.timeout(0.5):
            return 7

    for _ in range(3):
        assert await start(starter, quick()) == ("finished", 7)
    await asyncio.sleep(1)
    assert await start(starter, quick()) == ("finished", 7)


async def test_a_task_group_begun_in_the_first_step_works(starter):
    async def part(n):
        await asyncio.sleep(n)
        return n

    async def grouped():
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(part(n)) for n in (1, 2)]
        return [task.result() for task in tasks]

    _, task = await start(starter, grouped())
    assert await task == [1, 2]


async def test_group_whose_member_fails_cancels_the_started_parent(starter):
    async def fail():
        raise ValueError("no")

    async def grouped():
        async with asyncio.TaskGroup() as group:
            group.create_task(fail())
            await asyncio.sleep(10)

    _, task = await start(starter, grouped())
    with pytest.raises(ExceptionGroup):
        await task


@pytest.mark.parametrize("turns", [0, 1, 3])
async def test_cancellation_at_any_time_reaches_the_coroutine(starter, turns):
    cleaned = []

    async def slow():
        try:
            await asyncio.sleep(10)
        except asyncio.CancelledError:
            await asyncio.sleep(1)
            cleaned.append(True)
            raise

    loop = asyncio.get_running_loop()
    made = loop.create_future()

    def begin():
        task = starter.start(slow())
        if turns == 0:
            task.cancel()
        made.set_result(task)

    loop.call_soon(begin)
    task = await made
    for _ in range(turns):
        await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert cleaned == [True]


async def test_coroutine_may_suppress_its_cancellation(starter):
    async def stubborn():
        try:
            await asyncio.sleep(10)
        except asyncio.CancelledError:
            asyncio.current_task().uncancel()
            await asyncio.sleep(1)
            return "survived"

    _, task = await start(starter, stubborn())
    task.cancel()
    assert await task == "survived"


async def test_a_coroutine_that_cancels_itself_ends_at_its_next_wait(starter):
    async def tired():
        asyncio.current_task().cancel()
        await asyncio.sleep(10)

    _, task = await start(starter, tired())
    with pytest.raises(asyncio.CancelledError):
        await task

    async def quick():
        return 7

    assert await start(starter, quick()) == ("finished", 7)


async def test_a_coroutine_that_cancels_itself_and_returns_cancels_no_other(starter):
    async def tired():
        asyncio.current_task().cancel()
        return 7

    async def slow():
        cancels = asyncio.current_task().cancelling()
        await asyncio.sleep(1)
        return cancels

    def both():
        with pytest.raises(StopIteration):
            starter.start(tired())
        return starter.start(slow())

    _, task = await outside(both)
    assert await task == 0


@pytest.mark.skipif(not hasattr(asyncio, "eager_task_factory"), reason="new in Python 3.12")
async def test_cancel_taken_back_among_eager_tasks_cancels_no_other(starter):
    """Before Python 3.13.2, a task group does this if its eager task fails at once."""
    asyncio.get_running_loop().set_task_factory(asyncio.eager_task_factory)

    async def cancelled_and_uncancelled():
        asyncio.current_task().cancel()
        asyncio.current_task().uncancel()

    async def slow():
        await asyncio.sleep(1)
        return 7

    def both():
        with pytest.raises(StopIteration):
            starter.start(cancelled_and_uncancelled())
        return starter.start(slow())

    what, task = await outside(both)
    assert what == "returned"
    assert await task == 7


@pytest.mark.parametrize("has_begun", [True, False])
@pytest.mark.parametrize("turns", [0, 1])
async def test_cancel_taken_back_in_the_first_step_cancels_no_other(starter, has_begun, turns):
    async def quick():
        return None

    async def cancelled_and_uncancelled():
        asyncio.current_task().cancel()
        asyncio.current_task().uncancel()

    async def slow():
        await asyncio.sleep(1)
        return 7

    if has_begun:  # the spare task waits for a coroutine; otherwise it has not begun
        await start(starter, quick())
        await asyncio.sleep(0)
    loop = asyncio.get_running_loop()
    made = loop.create_future()

    def begin():
        with pytest.raises(StopIteration):
            starter.start(cancelled_and_uncancelled())
        later(turns)

    def later(turns):
        if turns:
            loop.call_soon(later, turns - 1)
        else:
            made.set_result(starter.start(slow()))

    loop.call_soon(begin)
    assert await asyncio.wait_for(await made, 2) == 7


async def test_errors_are_raised_by_the_start_or_the_task(starter):
    async def bad():
        raise KeyError("now")

    async def bad_later():
        await asyncio.sleep(1)
        raise KeyError("later")

    what, error = await start(starter, bad())
    assert (what, str(error)) == ("raised", "'now'")
    _, task = await start(starter, bad_later())
    with pytest.raises(KeyError, match="later"):
        await task


async def test_context_variable_of_one_coroutine_is_not_visible_to_the_next(starter):
    async def setting(value):
        before = variable.get()
        variable.set(value)
        return before

    assert await start(starter, setting("a")) == ("finished", "unset")
    assert await start(starter, setting("b")) == ("finished", "unset")
    assert variable.get() == "unset"


async def test_changed_context_variable_is_not_visible_to_the_next_coroutine(starter):
    """A variable that had a value before the service was made has it in every call."""
    variable.set("base")

    async def setting(value):
        before = variable.get()
        variable.set(value)
        return before

    assert await start(starter, setting("a")) == ("finished", "base")
    assert await start(starter, setting("b")) == ("finished", "base")
    assert variable.get() == "base"


async def test_context_variable_keeps_its_value_after_a_suspension(starter):
    async def setting():
        variable.set("mine")
        await asyncio.sleep(0)
        return variable.get()

    _, task = await start(starter, setting())
    assert await task == "mine"


async def test_call_is_that_of_the_coroutine_before_and_after_suspending(starter):
    async def look():
        first = answering.get()
        await asyncio.sleep(0)
        return first, answering.get()

    call = mock.Mock()
    _, (begun, has_ended) = await outside(starter.begin, look(), call)
    assert not has_ended
    assert await begun.task == (call, call)
    _, task = await start(starter, look())
    assert await task == (None, None)


async def test_start_inside_a_task_creates_a_task(starter):
    async def look():
        return asyncio.current_task(), answering.get()

    call = mock.Mock()
    begun, _ = starter.begin(look(), call)
    assert await begun.task == (begun.task, call)
    assert await starter.start(look()) != (begun.task, call)


async def test_each_later_step_reports_how_long_it_held_the_loop(starter, held):
    async def two_waits():
        await asyncio.sleep(1)
        await asyncio.sleep(1)

    _, task = await start(starter, two_waits())
    await task
    assert held == [0, 0]


async def test_an_abandoned_coroutine_is_closed(starter):
    closed = []

    async def slow():
        try:
            await asyncio.sleep(10)
        except GeneratorExit:
            closed.append(True)
            raise

    coroutine = slow()
    _, task = await start(starter, coroutine)
    await asyncio.sleep(0)
    task.get_coro().close()
    assert closed == [True]
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_closing_leaves_no_task():
    starter = EagerStarter(asyncio.get_running_loop(), lambda seconds: None)

    async def quick():
        return 7

    before = asyncio.all_tasks()
    await start(starter, quick())
    starter.close()
    await asyncio.sleep(0)
    assert asyncio.all_tasks() == before

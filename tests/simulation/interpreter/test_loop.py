"""asyncio works on virtual time in programs."""

import asyncio
import random

import pytest

from taskrpc.simulation.interpreter.loop import Policy, SimulatedLoop
from taskrpc.simulation.interpreter.stacks import Stacks
from taskrpc.simulation.interpreter.threads import Handle

pytestmark = pytest.mark.real_time


class TestInThisProcess:
    """A loop needs nothing but a stack."""

    @pytest.fixture
    def stacks(self):
        made = Stacks()
        yield made
        made.reset()

    def loop(self, stacks):
        return SimulatedLoop(stacks, random.Random(1), {})

    def run(self, stacks, *actions):
        for each in actions:
            stacks.start(each, Handle())
        return stacks.run(1000.0, lambda ready: 0, lambda: False)

    def test_two_loops_take_turns(self, stacks):
        seen = []

        async def work(name, seconds):
            for _ in range(3):
                seen.append(f"{name} {stacks.now:.0f}")
                await asyncio.sleep(seconds)

        def main(name, seconds):
            loop = self.loop(stacks)
            loop.run_until_complete(work(name, seconds))
            loop.close()

        self.run(stacks, lambda: main("a", 2), lambda: main("b", 3))
        assert seen == ["a 0", "b 0", "a 2", "b 3", "a 4", "b 6"]

    def test_callback_from_another_stack_wakes_the_loop(self, stacks):
        loop, seen = self.loop(stacks), []

        def serve():
            loop.run_forever()
            seen.append(f"stopped {stacks.now:.1f}")
            loop.close()

        def other():
            stacks.sleep(5)
            loop.call_soon_threadsafe(seen.append, "called")
            loop.call_soon(seen.append, "called, too")
            stacks.sleep(1)
            loop.call_later(2, loop.stop)

        self.run(stacks, serve, other)
        assert seen == ["called", "called, too", "stopped 8.0"]

    def test_loop_shows_the_virtual_time(self, stacks):
        loop = self.loop(stacks)
        stacks.now = 5.0
        assert loop.time() == 5.0
        loop.close()

    def test_stack_without_a_loop_has_none(self, stacks):
        policy = Policy(stacks, lambda: self.loop(stacks))
        with pytest.raises(RuntimeError, match="no current event loop"):
            policy.get_event_loop()

    def test_each_stack_sets_its_own_loop(self, stacks):
        policy, seen = Policy(stacks, lambda: self.loop(stacks)), []

        def work():
            loop = policy.new_event_loop()
            policy.set_event_loop(loop)
            stacks.sleep(1)
            seen.append(policy.get_event_loop() is loop)
            loop.close()

        self.run(stacks, work, work)
        assert seen == [True, True]


def lines_of(simulated, code, seed=0):
    return simulated(a=code).run(seed).lines["a"]


def test_tasks_queues_and_timeouts_wait_on_virtual_time(simulated):
    code = """
        import asyncio, time
        begin = time.monotonic()
        def at(what): print(what, round(time.monotonic() - begin, 1))
        async def put(queue):
            await asyncio.sleep(2)
            await queue.put("word")
        async def fail():
            await asyncio.sleep(1)
            raise ValueError("no")
        async def main():
            queue = asyncio.Queue()
            async with asyncio.TaskGroup() as group:
                group.create_task(put(queue))
                at(await queue.get())
            try:
                async with asyncio.timeout(3):
                    await queue.get()
            except TimeoutError:
                at("timeout")
            try:
                await asyncio.wait_for(asyncio.Event().wait(), 1)
            except TimeoutError:
                at("wait_for")
            try:
                async with asyncio.TaskGroup() as group:
                    group.create_task(fail())
                    group.create_task(asyncio.sleep(100))
            except* ValueError as error:
                at(error.exceptions[0])
            print([task.get_name() for task in asyncio.all_tasks()])
        asyncio.run(main())
        """
    assert lines_of(simulated, code) == [
        *["word 2.0", "timeout 5.0", "wait_for 6.0", "no 7.0", "['Task-1']"]
    ]


def test_threads_of_asyncio_wait_on_virtual_time(simulated):
    code = """
        import asyncio, time, threading
        def work():
            time.sleep(2)
            return threading.current_thread() is threading.main_thread()
        async def main():
            ticks = 0
            async def tick():
                nonlocal ticks
                while True:
                    ticks += 1
                    await asyncio.sleep(0.5)
            task = asyncio.create_task(tick())
            print(await asyncio.to_thread(work), ticks)
            loop = asyncio.get_running_loop()
            future = loop.create_future()
            threading.Timer(1, loop.call_soon_threadsafe, [future.set_result, "set"]).start()
            print(await future)
            later = asyncio.run_coroutine_threadsafe
            print(await asyncio.to_thread(lambda: later(asyncio.sleep(1, "slept"), loop).result()))
            task.cancel()
        asyncio.run(main())
        """
    lines = lines_of(simulated, code)
    assert lines[0] in ("False 4", "False 5")
    assert lines[1:] == ["set", "slept"]


def test_asynchronous_generators_are_closed_by_their_own_loop(simulated):
    code = """
        import asyncio, gc
        async def numbers():
            try:
                for number in range(9):
                    yield number
                    await asyncio.sleep(1)
            finally:
                await asyncio.sleep(0)
                print("closed")
        async def main():
            left = numbers()
            print(await anext(left))
            await asyncio.sleep(5)
            async for number in numbers():
                print(number)
                break
            await asyncio.sleep(1)
            kept.append(left)
        kept = []
        asyncio.run(main())
        print("end")
        """
    lines = simulated(a=code, b=code).run().lines
    for each in lines.values():
        assert each == ["0", "0", "closed", "closed", "end"]


def test_end_of_the_loop_cancels_tasks(simulated):
    code = """
        import asyncio
        async def work():
            try:
                await asyncio.sleep(100)
            finally:
                print("cancelled")
        async def main():
            task = asyncio.create_task(work())
            await asyncio.sleep(1)
            print("main")
        asyncio.run(main())
        """
    outcome = simulated(a=code).run()
    assert outcome.lines["a"] == ["main", "cancelled"]
    assert outcome.time < 3


def test_loop_in_a_thread_serves_other_threads(simulated):
    code = """
        import asyncio, threading
        loop = asyncio.new_event_loop()
        thread = threading.Thread(target=loop.run_forever)
        thread.start()
        print(asyncio.run_coroutine_threadsafe(asyncio.sleep(1, "done"), loop).result())
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
        """
    assert lines_of(simulated, code) == ["done"]


def test_signal_handler_of_a_loop_is_accepted(simulated):
    code = """
        import asyncio, signal
        async def main():
            loop = asyncio.get_running_loop()
            loop.add_signal_handler(signal.SIGTERM, print)
            print(loop.remove_signal_handler(signal.SIGTERM))
            print(loop.remove_signal_handler(signal.SIGTERM))
        asyncio.run(main())
        """
    assert lines_of(simulated, code) == ["True", "False"]


def test_exception_that_nobody_awaits_is_logged(simulated):
    code = """
        import asyncio
        async def fail(): raise ValueError("no battery")
        async def main():
            asyncio.create_task(fail())
            await asyncio.sleep(1)
        asyncio.run(main())
        """
    lines = lines_of(simulated, code)
    assert lines[0].startswith("Task exception was never retrieved")
    assert lines[-1] == "ValueError: no battery"


def test_select_waits_on_virtual_time(simulated):
    code = """
        import select, time
        begin = time.monotonic()
        print(select.select([], [], [], 3), round(time.monotonic() - begin, 1))
        """
    assert lines_of(simulated, code) == ["([], [], []) 3.0"]


def test_keyboard_is_never_ready(simulated):
    code = """
        import select, sys, time
        begin = time.monotonic()
        print(select.select([sys.stdin], [], [], 0.1)[0], round(time.monotonic() - begin, 1))
        print(repr(sys.stdin.readline()))
        """
    assert lines_of(simulated, code) == ["[] 0.1", "''"]

"""Threads, locks, queues and executors of programs wait on virtual time."""

import pytest

from taskrpc.simulation.interpreter import threads
from taskrpc.simulation.interpreter.stacks import Stacks
from taskrpc.simulation.interpreter.threads import Handle, Lock


class TestInThisProcess:
    """Locks and handles need nothing but stacks."""

    @pytest.fixture
    def stacks(self, monkeypatch):
        made = Stacks()
        monkeypatch.setattr(threads, "_scheduler", made, raising=False)
        yield made
        made.reset()

    def run(self, stacks, *actions, until=100.0):
        for each in actions:
            stacks.start(each, Handle())
        return stacks.run(until, lambda ready: 0, lambda: False)

    def test_lock_goes_to_the_stack_that_has_waited_longest(self, stacks):
        lock, seen = Lock(), []

        def work(name):
            with lock:
                seen.append(name)
                stacks.sleep(1)
            with lock:
                seen.append(name.upper())

        self.run(stacks, *[lambda name=name: work(name) for name in "abc"])
        assert seen == ["a", "b", "c", "A", "B", "C"]
        assert not lock.locked()

    def test_lock_without_blocking_returns_at_once(self, stacks):
        lock, seen = Lock(), []

        def work():
            seen.extend([lock.acquire(), lock.acquire(blocking=False), lock.acquire(timeout=0)])

        self.run(stacks, work)
        assert seen == [True, False, False]

    def test_lock_with_a_timeout_returns_after_it(self, stacks):
        lock, seen = Lock(), []

        def work():
            lock.acquire()
            seen.append(lock.acquire(timeout=5))
            seen.append(round(stacks.now, 3))

        self.run(stacks, work)
        assert seen == [False, 5.0]

    def test_lock_is_not_handed_to_a_killed_stack(self, stacks):
        lock, seen = Lock(), []

        def holder():
            with lock:
                stacks.sleep(5)

        def take(name):
            with lock:
                seen.append(name)

        self.run(stacks, holder, lambda: take("a"), lambda: take("b"), until=1.0)
        stacks.kill(list(stacks.all.values())[1])
        self.run(stacks)
        assert seen == ["b"]

    def test_lock_knows_its_owner(self, stacks):
        lock, seen = Lock(), []

        def work():
            with lock:
                seen.append(lock.owner == stacks.get_ident())
                stacks.sleep(1)

        self.run(stacks, work, work)
        assert seen == [True, True]

    def test_release_of_a_free_lock_is_an_error(self, stacks):
        with pytest.raises(RuntimeError, match="release unlocked lock"):
            Lock().release()

    def test_join_waits_for_the_end(self, stacks):
        handle, seen = Handle(), []

        def wait():
            handle.join(1)
            seen.append((handle.is_done(), round(stacks.now, 2)))
            handle.join()
            seen.append((handle.is_done(), round(stacks.now, 2)))

        stacks.start(lambda: stacks.sleep(3), handle)
        self.run(stacks, wait)
        assert seen == [(False, 1.0), (True, 3.0)]


pytestmark = pytest.mark.real_time


def lines_of(simulated, code, seed=0):
    return simulated(a=code).run(seed).lines["a"]


def test_primitives_of_threading_wait_on_virtual_time(simulated):
    code = """
        import threading, time
        begin = time.monotonic()
        def at(what): print(what, round(time.monotonic() - begin, 1))
        event, condition = threading.Event(), threading.Condition()
        semaphore, barrier = threading.Semaphore(0), threading.Barrier(2)
        def work():
            time.sleep(1); event.set()
            time.sleep(1)
            with condition: condition.notify()
            time.sleep(1); semaphore.release()
            time.sleep(1); barrier.wait()
        threading.Thread(target=work).start()
        print(event.wait(0.5)); at("early")
        print(event.wait()); at("event")
        with condition:
            print(condition.wait(10))
        at("condition")
        print(semaphore.acquire(timeout=10)); at("semaphore")
        barrier.wait(); at("barrier")
        threading.Timer(5, at, ["timer"]).start()
        """
    assert lines_of(simulated, code) == [
        *["False", "early 0.5", "True", "event 1.0", "True", "condition 2.0"],
        *["True", "semaphore 3.0", "barrier 4.0", "timer 9.0"],
    ]


def test_reentrant_lock_belongs_to_its_thread(simulated):
    code = """
        import threading, time
        lock = threading.RLock()
        def work():
            print(lock.acquire(blocking=False))
            print(lock.acquire(timeout=5))
        with lock, lock:
            thread = threading.Thread(target=work)
            thread.start()
            time.sleep(1)
        thread.join()
        """
    assert lines_of(simulated, code) == ["False", "True"]


def test_thread_locals_differ(simulated):
    code = """
        import threading, time
        own = threading.local()
        def work(name):
            own.name = name
            time.sleep(1)
            print(own.name)
        for name in "ab":
            threading.Thread(target=work, args=name).start()
        time.sleep(2)
        print(hasattr(own, "name"))
        """
    lines = lines_of(simulated, code)
    assert sorted(lines[:2]) == ["a", "b"]
    assert lines[2:] == ["False"]


def test_queues_wait_on_virtual_time(simulated):
    code = """
        import queue, threading, time
        begin = time.monotonic()
        for kind in queue.Queue, queue.SimpleQueue, queue.PriorityQueue:
            words = kind()
            def work():
                time.sleep(1)
                words.put("b")
            threading.Thread(target=work).start()
            print(words.get(timeout=5))
            try:
                words.get(timeout=2)
            except queue.Empty:
                print("empty", round(time.monotonic() - begin, 1))
        full = queue.Queue(1)
        full.put(1)
        try:
            full.put(2, timeout=1)
        except queue.Full:
            print("full", round(time.monotonic() - begin, 1))
        """
    assert lines_of(simulated, code) == [
        *["b", "empty 3.0", "b", "empty 6.0", "b", "empty 9.0", "full 10.0"]
    ]


def test_executors_run_on_virtual_time(simulated):
    code = """
        import time
        from concurrent.futures import ThreadPoolExecutor, as_completed, wait, TimeoutError
        begin = time.monotonic()
        def work(seconds):
            time.sleep(seconds)
            return seconds
        with ThreadPoolExecutor(2) as pool:
            print(list(pool.map(work, [3, 1, 1])), round(time.monotonic() - begin, 1))
            futures = [pool.submit(work, each) for each in (2, 1)]
            print([each.result() for each in as_completed(futures)])
            future = pool.submit(work, 9)
            try:
                future.result(timeout=1)
            except TimeoutError:
                print("late")
            print(len(wait([future], timeout=1).not_done))
        print(future.done(), round(time.monotonic() - begin, 1))
        """
    assert lines_of(simulated, code) == ["[3, 1, 1] 3.0", "[1, 2]", "late", "1", "True 14.0"]


def test_executor_that_is_not_shut_down_does_not_keep_a_program_alive(simulated):
    code = """
        from concurrent.futures import ThreadPoolExecutor
        pool = ThreadPoolExecutor()
        print(pool.submit(int, "5").result())
        """
    outcome = simulated(a=code).run()
    assert outcome.lines["a"] == ["5"]
    assert outcome.time < 1


def test_race_between_threads_is_found_with_some_seeds(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def all_counted(world):
            assert world.lines("a") == ["2"], world.lines("a")
        """,
        a="""
        import threading, time
        total = 0
        def work():
            global total
            value = total
            time.sleep(0)
            total = value + 1
        threads = [threading.Thread(target=work) for _ in range(2)]
        for each in threads: each.start()
        for each in threads: each.join()
        print(total)
        """,
    )
    assert loaded.first_failure().kind == "all_counted"


def test_enumerate_has_the_threads_of_the_program_alone(simulated):
    code = """
        import threading, time
        threading.Thread(target=time.sleep, args=(2,), name="{name}").start()
        time.sleep(1)
        print(sorted(each.name for each in threading.enumerate()), threading.active_count())
        time.sleep(3)
        print(threading.active_count())
        """
    lines = simulated(a=code.format(name="one"), b=code.format(name="two")).run().lines
    assert lines == {"a": ["['MainThread', 'one'] 2", "1"], "b": ["['MainThread', 'two'] 2", "1"]}

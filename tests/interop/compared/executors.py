"""Executors: nodes, shutdown, exceptions, callback groups, tasks and guard conditions."""

import threading
import time

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import (
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    SingleThreadedExecutor,
)
from rclpy.task import Future, Task
from rclpy.waitable import NumberOfEntities, Waitable
from shared import attempt, end, fails


def nodes():
    executor, other = SingleThreadedExecutor(), SingleThreadedExecutor()
    node = rclpy.create_node("one")
    attempt("no executor", lambda: node.executor)
    attempt("add", lambda: executor.add_node(node))
    attempt("add again", lambda: executor.add_node(node))
    attempt("add elsewhere", lambda: other.add_node(node))
    attempt("nodes", lambda: (len(executor.get_nodes()), len(other.get_nodes())))
    attempt("its executor", lambda: node.executor is other)
    attempt("remove elsewhere", lambda: executor.remove_node(node))
    attempt("remove", lambda: other.remove_node(node))
    attempt("remove again", lambda: other.remove_node(node))
    attempt("assign", lambda: setattr(node, "executor", executor))
    attempt("nodes", lambda: len(executor.get_nodes()))
    attempt("shutdown", executor.shutdown)
    attempt("shutdown again", executor.shutdown)
    attempt("nodes", lambda: len(executor.get_nodes()))
    attempt("spin_once", lambda: executor.spin_once(timeout_sec=0))
    attempt("spin", executor.spin)
    attempt("add after", lambda: executor.add_node(node))
    attempt("task after", lambda: type(executor.create_task(print)).__name__)
    attempt("context", lambda: other.context is node.context)
    for threads in (0, 1, -1, None, "2"):
        fails(
            f"{threads!r} threads",
            lambda threads=threads: type(MultiThreadedExecutor(threads)).__name__,
        )
    with SingleThreadedExecutor() as inner:
        inner.add_node(node)
    attempt("after with", lambda: inner.spin_once(timeout_sec=0))


def tasks():
    executor = SingleThreadedExecutor()
    task = executor.create_task(lambda a, b: a + b, 1, b=2)
    attempt("task", lambda: (type(task) is Task, task.done(), task.result()))
    executor.spin_until_future_complete(task, 5)
    attempt("done", lambda: (task.done(), task.result()))
    wrong = executor.create_task(lambda: 1 / 0)
    attempt("spins", lambda: executor.spin_until_future_complete(wrong, 5))
    attempt("exception", lambda: repr(wrong.exception()))
    attempt("result", wrong.result)

    async def two_steps(future):
        return await future + 1

    future = Future(executor=executor)
    task = executor.create_task(two_steps, future)
    executor.spin_once(timeout_sec=0.1)
    attempt("waits", task.done)
    future.set_result(4)
    executor.spin_until_future_complete(task, 5)
    attempt("awaited", task.result)
    attempt("cancel", lambda: (task.cancel(), task.cancelled()))
    pending = Future()
    attempt("timeout", lambda: executor.spin_until_future_complete(pending, 0.05))
    attempt("no future", lambda: executor.spin_until_future_complete(5, 0.05))
    told = []
    pending.add_done_callback(lambda future: told.append(future.result()))
    pending.set_result(7)
    pending.add_done_callback(lambda future: told.append("late"))
    attempt("callbacks", lambda: told)
    attempt("set again", lambda: (pending.set_result(8), pending.result()))
    failed = Future()
    failed.set_exception(ValueError("x"))
    attempt("failed", failed.result)
    attempt("failed exception", failed.exception)
    attempt("no exception", lambda: Future().set_exception("x"))


def exceptions():
    for cls in (SingleThreadedExecutor, MultiThreadedExecutor):
        executor = cls()
        node = rclpy.create_node("wrong")
        executor.add_node(node)
        timer = node.create_timer(0.01, lambda: 1 / 0)

        def spin(executor=executor):
            limit = time.monotonic() + 10
            while time.monotonic() < limit:
                executor.spin_once(timeout_sec=0.1)

        attempt(f"{cls.__name__} timer", spin)
        node.destroy_timer(timer)
        guard = node.create_guard_condition(lambda: {}["key"])
        guard.trigger()
        attempt(f"{cls.__name__} guard", spin)
        executor.remove_node(node)
        executor.shutdown()


def groups():
    node = rclpy.create_node("groups")
    exclusive, reentrant = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
    attempt("default", lambda: type(node.default_callback_group).__name__)
    for group in (exclusive, reentrant):
        running, most, done = [], [], threading.Semaphore(0)

        def work(running=running, most=most, done=done):
            running.append(1)
            most.append(len(running))
            time.sleep(0.1)
            running.pop()
            done.release()

        guards = [node.create_guard_condition(work, group) for _ in range(3)]
        print("has", group.has_entity(guards[0]), flush=True)
        executor = MultiThreadedExecutor(4)
        executor.add_node(node)
        for guard in guards:
            guard.trigger()
        limit = time.monotonic() + 10
        while len(most) < 3 and time.monotonic() < limit:
            executor.spin_once(timeout_sec=0.1)
        for _ in guards:
            done.acquire(timeout=10)
        print(type(group).__name__, max(most), flush=True)
        for guard in guards:
            node.destroy_guard_condition(guard)
        executor.remove_node(node)
        executor.shutdown()
    fails("no group", lambda: node.create_timer(1.0, print, callback_group=5))


class Ready(Waitable):
    """A waitable that a guard condition makes ready."""

    def __init__(self, node):
        super().__init__(node.default_callback_group)
        self.guard = node.create_guard_condition(None)
        self.log = []
        self.index = None
        self.is_set = False

    def __enter__(self):
        self._entered = True

    def __exit__(self, *exc_info):
        self._entered = False

    def add_to_wait_set(self, wait_set):
        self.index = wait_set.add_guard_condition(self.guard.handle)

    def is_ready(self, wait_set):
        if wait_set.is_ready("guard_condition", self.index):
            self.is_set = True
        return self.is_set

    def take_data(self):
        self.is_set = False
        return "data"

    async def execute(self, taken_data):
        self.log.append(taken_data)

    def get_num_entities(self):
        return NumberOfEntities(num_gcs=1)


def waitables():
    executor = SingleThreadedExecutor()
    node = rclpy.create_node("waits")
    executor.add_node(node)
    waitable = Ready(node)
    node.add_waitable(waitable)
    executor.spin_once(timeout_sec=0.05)
    print("nothing", waitable.log, flush=True)
    total = NumberOfEntities(1, 2) + NumberOfEntities(num_events=3)
    attempt("sum", lambda: (total.num_subscriptions, total.num_guard_conditions, total.num_events))
    attempt("waitables", lambda: waitable in list(node.waitables))
    node.remove_waitable(waitable)
    attempt("removed", lambda: waitable in list(node.waitables))
    told = []
    guard = node.create_guard_condition(lambda: told.append(1))
    for _ in range(3):
        guard.trigger()
    for _ in range(4):
        executor.spin_once(timeout_sec=0.05)
    print("three triggers", len(told), flush=True)
    attempt("destroy", lambda: node.destroy_guard_condition(guard))
    attempt("trigger", guard.trigger)


def shutdowns():
    executor = SingleThreadedExecutor()
    node = rclpy.create_node("ends")
    executor.add_node(node)
    timer = node.create_timer(0.1, lambda: rclpy.shutdown())
    attempt("spin", executor.spin)
    attempt("ok", rclpy.ok)
    attempt("spin after", executor.spin)
    attempt("spin_once after", lambda: executor.spin_once(timeout_sec=0.1))
    attempt(
        "kinds",
        lambda: (
            issubclass(ExternalShutdownException, Exception),
            ShutdownException.__mro__[1].__name__,
        ),
    )
    attempt("timer", timer.is_canceled)


rclpy.init()
nodes()
tasks()
exceptions()
groups()
waitables()
shutdowns()
end()

"""The schedule plans as few tasks again as possible."""

import pytest

from taskrpc.robot.protocol import Pose
from taskrpc.robot.tasks.queue.task_queue import TaskQueue
from tests.robot.tasks.queue.test_task_queue import first, journey, make

HOME = Pose(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "step", ["put", "put_first", "remove", "reprioritise", "take", "estimate", "preview"]
)
async def test_the_work_of_a_step_does_not_grow_with_the_queue(step):
    """Counted in plans made, which is where the time goes; one step among 52 and among 2,000."""
    assert max(count_plans(step, size) for size in (52, 2_000)) <= 5


def count_plans(step, size):
    plans = 0

    def counting(task, start):
        nonlocal plans
        plans += 1
        return journey(task, start)

    queue = TaskQueue(counting, HOME)
    for number in range(1, size + 1):
        queue.put(make(number, priority=5, target=str(number % 4)))
    plans = 0
    steps = {
        "put": lambda: queue.put(make(size + 1)),
        "put_first": lambda: queue.put(make(size + 1, priority=10)),
        "remove": lambda: queue.remove(size // 2),
        "reprioritise": lambda: queue.reprioritise(size // 2, 9),
        "take": lambda: queue.begin(first(queue)),
        "estimate": lambda: queue.seconds_through(queue.find(size)),
        "preview": lambda: queue.seconds_with(make(size + 1)),
    }
    steps[step]()
    return plans

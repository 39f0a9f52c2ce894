"""Hidden checks of lab 5: an urgent task, a second busy phase, and two tasks of one kind."""

from taskrpc.course.labs.checks.lab5 import Desk, expect_order
from taskrpc.course.labs.lab import Check, NotMet


async def _urgent(trial):
    desk = await Desk.started(trial)
    seconds = desk.work.seconds
    await desk.accept(desk.longest, 1)
    await desk.executing(1)
    for _ in range(3):
        await desk.accept(desk.longest, 1)
    urgent = await desk.accept(desk.shortest, 10)
    most = seconds[desk.longest] + seconds[desk.shortest]
    if urgent.estimate > most + 0.5:
        raise NotMet(
            f"an estimate of at most {most:g} s for a task of priority 10: less important tasks"
            " come after it",
            f"estimated_time={urgent.estimate:.1f}",
            "which of the waiting tasks come before this one?",
        )


async def _overtakes(trial):
    desk = await Desk.started(trial)
    first = await desk.accept(desk.middle, 1)
    await desk.executing(first.id)
    tasks = [await desk.accept(desk.middle, priority) for priority in (2, 2, 1)]
    await desk.executing(tasks[0].id)
    tasks.append(await desk.accept(desk.shortest, 9))
    executed = await desk.all_executed(5, 5 * desk.work.seconds[desk.middle])
    if executed[1] != tasks[0].id:
        raise NotMet(
            f"task {tasks[0].id} after task 1",
            f"the order was {executed}",
            "a task that runs is not interrupted",
        )
    expect_order(tasks[1:], executed[1:])


async def _rests(trial):
    desk = await Desk.started(trial)
    for number in (1, 2):
        await desk.accept(desk.shortest, 5)
        await desk.executing(number)
        await trial.sleep(desk.work.seconds[desk.shortest] + 1.0)


CHECKS = (
    Check("an urgent task does not wait for less important ones", 1, _urgent),
    Check("an urgent task overtakes waiting ones, and interrupts none", 1, _overtakes),
    Check("the worker goes on after a rest", 1, _rests),
)

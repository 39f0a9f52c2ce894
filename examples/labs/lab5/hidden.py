"""Hidden checks of lab 5: an urgent task, a second busy phase, and two tasks of one kind."""

from taskrpc.course.labs.checks.lab5 import Desk, executed, expect_order, simulated, work_of
from taskrpc.course.labs.lab import Check, NotMet


async def _urgent(trial):
    work = work_of(trial.variant)
    longest, _, shortest = work.types
    early = work.seconds[longest] / 4
    waiting = [(longest, 1, early)] * 3
    _, tasks, _ = await simulated(
        trial, [(longest, 1, 0.0), *waiting, (shortest, 10, early + 0.1)]
    )
    urgent = tasks[-1]
    most = work.seconds[longest] + work.seconds[shortest]
    if urgent.estimate > most + 0.5:
        raise NotMet(
            f"an estimate of at most {most:g} s for a task of priority 10: less important tasks"
            " come after it",
            f"estimated_time={urgent.estimate:.1f}",
            "which of the waiting tasks come before this one?",
        )


async def _overtakes(trial):
    work = work_of(trial.variant)
    _, middle, shortest = work.types
    seconds = work.seconds[middle]
    early = [(middle, priority, seconds / 2) for priority in (2, 2, 1)]
    sent = [(middle, 1, 0.0), *early, (shortest, 9, 1.5 * seconds)]
    server, (_, *tasks), _ = await simulated(trial, sent)
    done = executed(server)
    if done[1:2] != [min(each.id for each in tasks if each.priority == 2)]:
        raise NotMet(
            "the first task of priority 2 after task 1",
            f"the order was {done}",
            "a task that runs is not interrupted",
        )
    expect_order([each for each in tasks if each.id != done[1]], done[1:])


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

"""Hidden checks of lab 6: two scans at once, and the three programs together."""

import asyncio

import srvgen
from taskrpc.course.labs.checks.common import answer, ended, service_of
from taskrpc.course.labs.lab import Check, NotMet


def _robot(trial):
    from taskrpc.course.labs.checks.lab6 import LAB

    return LAB.values(trial.variant)["ROBOT"]


async def _scans(trial):
    trigger = srvgen.load("std_srvs/srv/Trigger")
    program = await trial.start("robot.py")
    scan = await service_of(trial, program, trigger, f"/{_robot(trial)}/scan")

    async def seconds(scans):
        started = trial.time()
        wanted = [answer(scan, trigger.Request(), "an empty request") for _ in range(scans)]
        await asyncio.gather(*wanted)
        return trial.time() - started

    # Each is measured twice: on a busy machine, one scan may take longer than it has to.
    one = min(await seconds(1), await seconds(1))
    two = min(await seconds(2), await seconds(2))
    if two > 1.7 * one:
        raise NotMet(
            "two scans at the same time to take as long as one",
            f"one took {one:.1f} s, two took {two:.1f} s",
            "what does a scan keep waiting?",
        )


async def _together(trial):
    trigger = srvgen.load("std_srvs/srv/Trigger")
    for file, name in (("robot.py", f"/{_robot(trial)}/scan"), ("planner.py", "/mission")):
        await trial.start(file)
        if not await trial.node.create_client(trigger, name).wait_for_service(timeout=30.0):
            raise NotMet(
                f"{file} to offer {name}, also if the other programs run",
                "it did not within 30 s",
                "start all three programs, and read their logs",
            )
    for _ in range(2):
        console = await trial.start("console.py")
        code = await console.finished(40.0)
        for wanted in ("the light is on", "87 percent", "3 objects"):
            if not any(wanted in line for line in console.output):
                raise NotMet(
                    f"the console to print {wanted!r}",
                    "it still runs" if code is None else ended(console, code),
                    "start all three programs, and read their logs",
                )


CHECKS = (
    Check("two scans run at the same time", 1, _scans),
    Check("the three programs work together, and again", 1, _together),
)

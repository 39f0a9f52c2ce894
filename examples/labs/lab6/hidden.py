"""Hidden checks of lab 6: two scans at once, and the three programs together."""

import srvgen
from taskrpc.course.labs.checks.common import ended
from taskrpc.course.labs.lab import Check, NotMet
from taskrpc.course.labs.trial import Call


def _robot(trial):
    from taskrpc.course.labs.checks.lab6 import LAB

    return LAB.values(trial.variant)["ROBOT"]


async def _scans(trial):
    request = srvgen.load("std_srvs/srv/Trigger").Request()
    calls = [Call("std_srvs/srv/Trigger", f"/{_robot(trial)}/scan", request, 0.0)] * 2
    robot = await trial.simulate("robot.py", duration=60.0, calls=calls)
    seconds = sorted(each.time - each.began for each in robot.responses if each.message)
    if len(seconds) < 2 or seconds[1] > 1.7 * seconds[0]:
        raise NotMet(
            "two scans at the same time to take as long as one",
            f"they took {' and '.join(f'{each:.1f}' for each in seconds) or 'too many'} s",
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

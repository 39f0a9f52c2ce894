"""Hidden checks of lab 4: a late response, a callback that fails, and no robot at all."""

from taskrpc.course.labs.checks.lab4 import (
    Robot,
    end_of,
    expect_one_line,
    expect_one_run,
    expect_response,
    retry_of,
    targets_of,
)
from taskrpc.course.labs.lab import Check, NotMet


async def _late(trial):
    retry = retry_of(trial.variant)
    targets = targets_of(trial.variant)[:2]
    # The response of the first attempt arrives while the client waits for the second one.
    async with Robot(trial, lose=1, late=retry.timeout + retry.first_wait / 2).offered() as robot:
        client = await trial.start("client.py", *targets)
        code = await end_of(client, robot, 2 * (retry.timeout + retry.first_wait))
        expect_one_run(robot, targets)
        for target in targets:
            expect_response(client, code, robot, target)


async def _fails(trial):
    retry = retry_of(trial.variant)
    target = targets_of(trial.variant)[0]
    async with Robot(trial, lose=1, fails=True).offered() as robot:
        client = await trial.start("client.py", target)
        code = await end_of(client, robot, retry.timeout + retry.first_wait)
        if len(robot.requests) < 2:
            raise NotMet(
                "a second attempt after a callback that failed",
                f"it ended with exit code {code}: {client.output[-1:]}",
                "future.result() raises what the call raised",
            )
        expect_response(client, code, robot, target)


async def _absent(trial):
    retry = retry_of(trial.variant)
    target = targets_of(trial.variant)[0]
    client = await trial.start("client.py", target)
    code = await client.finished(60.0 + 2 * retry.total)
    if code is None:
        raise NotMet(
            "the client to end its attempts if there is no robot",
            "it still runs",
            "wait_for_service has an argument timeout_sec",
        )
    expect_one_line(client, code, target, retry)


CHECKS = (
    Check("a late response does no harm", 1, _late),
    Check("an attempt that fails is repeated", 1, _fails),
    Check("the client ends its attempts if there is no robot", 1, _absent),
)

"""Reads a sensor that fails twice out of three: by hand, and with two retry policies."""

import sys
import time
from typing import Any

import srvgen
import taskrpc
from taskrpc import sync

Trigger = srvgen.load("std_srvs/srv/Trigger")

FIRST_WAIT = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0


def read_by_hand(client: sync.Client[Any, Any]) -> str:
    # The lecture's loop: wait 1 s, then 2 s, then 4 s, so that a server in trouble gets air.
    for attempt in range(3):
        try:
            return str(client.call(Trigger.Request(), timeout=5.0).message)
        except taskrpc.HandlerFailed as error:
            wait = FIRST_WAIT * 2**attempt
            print(f"  attempt {attempt + 1} failed ({error}), the next one in {wait} s")
            time.sleep(wait)
    return "all attempts failed"


def read_with_policy(client: sync.Client[Any, Any], policy: taskrpc.RetryPolicy) -> str:
    # The same in one argument, and it repeats only what is safe to repeat.
    return str(client.call(Trigger.Request(), retry=policy).message)


def main() -> None:
    lecture = taskrpc.RetryPolicy(
        attempts=3, attempt_timeout=5, wait_initial=FIRST_WAIT, wait_max=8, wait_jitter=0
    )
    # Short waits, drawn at random: a hundred clients must not all come back at the same moment.
    default = taskrpc.RetryPolicy()
    with sync.Node("retry_client") as node:
        client = node.create_client(Trigger, "read_sensor")
        try:
            began = time.monotonic()
            print(f"by hand: {read_by_hand(client)} after {time.monotonic() - began:.2f} s")
            for name, policy in (("the lecture's policy", lecture), ("the default", default)):
                began = time.monotonic()
                answer = read_with_policy(client, policy)
                print(f"{name}: {answer} after {time.monotonic() - began:.2f} s")
        except taskrpc.TaskRpcError as error:
            sys.exit(f"the call failed: {error}")


if __name__ == "__main__":
    main()

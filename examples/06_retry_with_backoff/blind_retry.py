"""Why a retry can be dangerous: the robot shall drive ONE metre, and its answer is late."""

import sys
from typing import Any

import srvgen
import taskrpc
from taskrpc import sync

Trigger = srvgen.load("std_srvs/srv/Trigger")


def drive_blindly(client: sync.Client[Any, Any]) -> None:
    # Wrong: no answer does not mean that nothing was done.
    for attempt in range(1, 4):
        try:
            client.call(Trigger.Request(), timeout=0.2)
            return
        except taskrpc.DeadlineExceeded as error:
            print(f"  attempt {attempt}: no answer (certainly not run: {error.not_executed})")


def drive_with_policy(client: sync.Client[Any, Any]) -> None:
    try:
        client.call(Trigger.Request(), timeout=0.2, retry=taskrpc.RetryPolicy())
    except taskrpc.DeadlineExceeded:
        print("  no answer, so ask where the robot is before you go on")


def main() -> None:
    with sync.Node("driver") as node:
        drive = node.create_client(Trigger, "drive_one_metre")
        position = node.create_client(Trigger, "get_position")
        try:
            print(f"the robot is at {position.call(Trigger.Request()).message}")
            print("a blind loop:")
            drive_blindly(drive)
            print(f"  the robot is at {position.call(Trigger.Request()).message}")
            print("a retry policy, which never repeats what may have been done:")
            drive_with_policy(drive)
            print(f"  the robot is at {position.call(Trigger.Request()).message}")
        except taskrpc.TaskRpcError as error:
            sys.exit(f"the call failed: {error}")


if __name__ == "__main__":
    main()

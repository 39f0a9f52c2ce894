"""Calls a slow service with enough time, and with too little."""

import sys
import time
from typing import Any

import srvgen
import taskrpc
from taskrpc import sync

Trigger = srvgen.load("std_srvs/srv/Trigger")

# What we grant the server: plenty, and too little.
LONG, SHORT = (float(argument) for argument in sys.argv[1:3] or (2.0, 0.4))


def try_call(client: sync.Client, timeout: float) -> None:
    began = time.monotonic()
    outcome: Any
    try:
        outcome = client.call(Trigger.Request(), timeout=timeout).message
    except taskrpc.DeadlineExceeded as error:
        outcome = f"DeadlineExceeded: {error}"
    took = time.monotonic() - began
    print(f"{client.service_name} with a timeout of {timeout} s: {outcome} (after {took:.2f} s)")


def main() -> None:
    with sync.Node("timeout_client") as node:
        scan = node.create_client(Trigger, "scan")
        quick_scan = node.create_client(Trigger, "quick_scan")
        try:
            try_call(scan, timeout=LONG)
            try_call(scan, timeout=SHORT)
            try_call(quick_scan, timeout=SHORT)
        except taskrpc.TaskRpcError as error:
            sys.exit(f"the call failed: {error}")


if __name__ == "__main__":
    main()

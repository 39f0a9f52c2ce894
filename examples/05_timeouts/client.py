"""Calls a slow service with enough time, and with too little."""

import sys
import time
from typing import Any

import srvgen
import taskrpc
from taskrpc import sync

Trigger = srvgen.load("std_srvs/srv/Trigger")

# Seconds that we grant the server: plenty, and too few.
LONG = float(sys.argv[1]) if len(sys.argv) > 1 else 2.0
SHORT = float(sys.argv[2]) if len(sys.argv) > 2 else 0.4


def try_call(client: sync.Client[Any, Any], timeout: float) -> None:
    began = time.monotonic()
    try:
        outcome = str(client.call(Trigger.Request(), timeout=timeout).message)
    except taskrpc.DeadlineExceeded as error:
        outcome = f"DeadlineExceeded (certainly not run: {error.not_executed})"
    took = time.monotonic() - began
    print(f"{client.service_name} with a timeout of {timeout} s: {outcome} after {took:.2f} s")


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

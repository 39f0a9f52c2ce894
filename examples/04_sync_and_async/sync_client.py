"""Four blocking calls: each line waits for the one before it."""

import sys
import time

import srvgen
import taskrpc
from taskrpc import sync

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def main() -> None:
    with sync.Node("sync_client") as node:
        client = node.create_client(AddTwoInts, "slow_add")
        began = time.monotonic()
        for n in range(1, 5):
            try:
                # The program stands still in this line until the response is here.
                response = client.call(AddTwoInts.Request(a=n, b=n))
            except taskrpc.TaskRpcError as error:
                sys.exit(f"the call failed: {error}")
            print(f"{n} + {n} = {response.sum} after {time.monotonic() - began:.2f} s")
        print(f"four calls one after another took {time.monotonic() - began:.2f} s")


if __name__ == "__main__":
    main()

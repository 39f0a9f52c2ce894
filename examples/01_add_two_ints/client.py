"""Asks the server for a sum: python client.py 2 3."""

import sys

import srvgen
import taskrpc
from taskrpc import sync

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def main() -> None:
    if len(sys.argv) != 3:
        sys.exit("usage: python client.py A B")
    a, b = int(sys.argv[1]), int(sys.argv[2])

    with sync.Node("add_two_ints_client") as node:
        client = node.create_client(AddTwoInts, "add_two_ints")
        # Nobody promises that the server was started first.
        while not client.wait_for_service(timeout=1.0):
            print("waiting for /add_two_ints ... is server.py running?")
        try:
            response = client.call(AddTwoInts.Request(a=a, b=b))
        except taskrpc.TaskRpcError as error:
            # A call goes through a network and another program: it can always fail.
            sys.exit(f"the call failed: {error}")
        print(f"{a} + {b} = {response.sum}")


if __name__ == "__main__":
    main()

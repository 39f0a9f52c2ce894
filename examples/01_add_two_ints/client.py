"""Asks the server for a sum: python client.py 2 3."""

import argparse
import sys

import srvgen
import taskrpc
from taskrpc import sync

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("a", type=int)
    parser.add_argument("b", type=int)
    typed = parser.parse_args()

    with sync.Node("add_two_ints_client") as node:
        client = node.create_client(AddTwoInts, "add_two_ints")
        # Nobody promises that the server was started first.
        while not client.wait_for_service(timeout=1.0):
            print("waiting for /add_two_ints ... is server.py running?")
        try:
            response = client.call(AddTwoInts.Request(a=typed.a, b=typed.b))
        except taskrpc.TaskRpcError as error:
            # A call goes through a network and another program: it can always fail.
            sys.exit(f"the call failed: {error}")
        print(f"{typed.a} + {typed.b} = {response.sum}")


if __name__ == "__main__":
    main()

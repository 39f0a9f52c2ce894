"""Sends distances to be checked: python client.py 2.5 0.8 30."""

import sys
from pathlib import Path

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook(Path(__file__).parent)
from my_interfaces.srv import CheckScan


def main() -> None:
    ranges = [float(argument) for argument in sys.argv[1:]]
    with sync.Node("scan_client") as node:
        client = node.create_client(CheckScan, "check_scan")
        # max_range is not given here, so it has the default that the .srv file says: 10.0.
        request = CheckScan.Request(ranges=ranges)
        print(f"request:  {request}")
        try:
            response = client.call(request)
        except taskrpc.TaskRpcError as error:
            sys.exit(f"the call failed: {error}")
        print(f"response: {response}")
        if response.advice == CheckScan.Response.STOP:
            print("The robot stops!")


if __name__ == "__main__":
    main()

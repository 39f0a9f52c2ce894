"""A service that adds two numbers."""

from typing import Any

import srvgen
from taskrpc import sync

# A service has a type: it says what a request is made of, and what a response.
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request: Any, response: Any) -> Any:
    # Called once a request. The response comes empty; what we return travels back.
    response.sum = request.a + request.b
    print(f"request: {request.a} + {request.b} = {response.sum}")
    return response


def main() -> None:
    with sync.Node("add_two_ints_server") as node:
        node.create_service(AddTwoInts, "add_two_ints", add)
        print("/add_two_ints is ready; Ctrl-C ends it")
        node.spin()  # waits for requests until Ctrl-C


if __name__ == "__main__":
    main()

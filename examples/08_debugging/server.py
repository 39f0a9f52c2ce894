"""A server with one service that works and three with the mistakes that everybody makes once."""

from typing import Any

import srvgen
from taskrpc import sync

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request: Any, response: Any) -> Any:
    response.sum = request.a + request.b
    return response


def forgets_return(request: Any, response: Any) -> None:
    response.sum = request.a + request.b


def misspells_field(request: Any, response: Any) -> Any:
    response.summe = request.a + request.b
    return response


def divides(request: Any, response: Any) -> Any:
    response.sum = int(request.a / request.b)
    return response


def main() -> None:
    with sync.Node("buggy_server") as node:
        node.create_service(AddTwoInts, "add", add)
        # mypy reports this mistake: the comment silences it.
        node.create_service(AddTwoInts, "forgets_return", forgets_return)  # type: ignore[arg-type]
        node.create_service(AddTwoInts, "misspells_field", misspells_field)
        node.create_service(AddTwoInts, "divides", divides)
        print("buggy_server is ready; Ctrl-C ends it")
        node.spin()


if __name__ == "__main__":
    main()

"""Callbacks without annotations, as beginners write them: pyright sees what they return."""

import srvgen
import taskrpc

srvgen.install_import_hook()

from my_interfaces.srv import Greet


def forgets(request, response):
    # mypy reports: Function is missing a type annotation
    response.greeting = request.name


async def forgets_later(request, response):
    # mypy reports: Function is missing a type annotation
    response.greeting = request.name


def greet(request, response):
    # mypy reports: Function is missing a type annotation
    response.greeting = request.name
    return response


def main(node: taskrpc.Node) -> None:
    node.create_service(Greet, "greet", greet)
    node.create_service(Greet, "greet", forgets)
    # pyright reports: …Function return type "None" is incompatible…
    node.create_service(Greet, "greet", forgets_later)
    # pyright reports: …Function return type "CoroutineType[Any, Any, None]" is incompatible…
    node.create_service(Greet, "greet", lambda request, response: None)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type …
    # mypy reports: Incompatible return value type (got "None", expected …
    # pyright reports: …Function return type "None" is incompatible…

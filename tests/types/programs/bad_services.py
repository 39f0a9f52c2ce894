"""Callbacks of services that take or return the wrong thing."""

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook()

from my_interfaces.srv import Add, Greet


def returns_nothing(request: Greet.Request, response: Greet.Response) -> None:
    response.greeting = request.name


async def returns_nothing_later(request: Greet.Request, response: Greet.Response) -> None:
    response.greeting = request.name


def returns_another(request: Greet.Request, response: Greet.Response) -> Add.Response:
    return Add.Response()


def returns_the_request(request: Greet.Request, response: Greet.Response) -> Greet.Request:
    return request


def takes_another(request: Add.Request, response: Greet.Response) -> Greet.Response:
    return response


def takes_anything_returns_another(request: object, response: object) -> Add.Response:
    return Add.Response()


def takes_one(request: Greet.Request) -> Greet.Response:
    return Greet.Response()


def effect_of_another(
    request: Greet.Request, response: Greet.Response
) -> taskrpc.Effect[Add.Response]:
    return taskrpc.Effect(Add.Response(), None)


def take(call: taskrpc.DeferredCall[Greet.Request, Greet.Response]) -> None:
    call.reply(Add.Response())
    # mypy reports: Argument 1 to "reply" of "DeferredCall" has incompatible type "Add_Response"; expected "Greet_Response"
    # pyright reports: …"Add_Response" is not assignable to "Greet_Response"
    print(call.request.a)
    # mypy reports: "Greet_Request" has no attribute "a"
    # pyright reports: Cannot access attribute "a" for class "Request"


def main(node: taskrpc.Node, blocking: sync.Node) -> None:
    node.create_service(Greet, "greet", returns_nothing)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], None]"; expected …
    # pyright reports: …Function return type "None" is incompatible…
    node.create_service(Greet, "greet", returns_nothing_later)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], Coroutine[Any, Any, None]]"; expected …
    # pyright reports: …Function return type "CoroutineType[Any, Any, None]" is incompatible…
    node.create_service(Greet, "greet", returns_another)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], Add_Response]"; expected …
    # pyright reports: …Function return type "Response" is incompatible…
    node.create_service(Greet, "greet", returns_the_request)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], Greet_Request]"; expected …
    # pyright reports: …Function return type "Request" is incompatible…
    node.create_service(Greet, "greet", takes_another)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Add_Request, Greet_Response], Greet_Response]"; expected …
    # pyright reports: …"Greet_Request" is not assignable to "Add_Request"
    node.create_service(Greet, "greet", takes_anything_returns_another)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[object, object], Add_Response]"; expected …
    # pyright reports: …Type "Greet_Response | Response" is not assignable to type "Greet_Response"
    node.create_service(Greet, "greet", takes_one)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request], Greet_Response]"; expected …
    # pyright reports: …Function accepts too few positional parameters; expected 2 but received 1
    node.create_service(Greet, "greet", effect_of_another)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], Effect[Add_Response]]"; expected …
    # pyright reports: …Function return type "Effect[Response]" is incompatible…
    node.create_service(Greet.Request, "greet", returns_nothing)
    # mypy reports: Argument 1 to "create_service" of "Node" has incompatible type "type[Greet_Request]"; expected "type[Srv[Greet_Request, Greet_Response]]"
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], None]"; expected …
    # pyright reports: …"Request" is incompatible with protocol "Srv…
    # pyright reports: …Function return type "None" is incompatible…
    node.create_deferred_service(Add, "add", take)
    # mypy reports: Argument 3 to "create_deferred_service" of "Node" has incompatible type "Callable[[DeferredCall[Greet_Request, Greet_Response]], None]"; expected …
    # pyright reports: …Type parameter "RequestT@DeferredCall" is invariant, but "Add_Request" is not the same as "Request"
    blocking.create_service(Greet, "greet", returns_nothing)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], None]"; expected …
    # pyright reports: …Function return type "None" is incompatible…
    blocking.create_service(Greet, "greet", takes_another)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Add_Request, Greet_Response], Greet_Response]"; expected …
    # pyright reports: …"Greet_Request" is not assignable to "Add_Request"
    blocking.create_deferred_service(Add, "add", take)
    # mypy reports: Argument 3 to "create_deferred_service" of "Node" has incompatible type "Callable[[DeferredCall[Greet_Request, Greet_Response]], None]"; expected …
    # pyright reports: …Type parameter "RequestT@DeferredCall" is invariant, but "Add_Request" is not the same as "Request"


def without_a_code(request: Greet.Request, response: Greet.Response) -> Greet.Response:
    raise taskrpc.HandlerError("the arm is stuck")
    # mypy reports: Missing positional argument "message" in call to "HandlerError"
    # pyright reports: …Argument missing for parameter "message"

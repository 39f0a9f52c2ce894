"""Wrong requests and misread responses."""

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook()

from my_interfaces.msg import Spot
from my_interfaces.srv import Add, Greet

Loaded = srvgen.load("my_interfaces/srv/Greet")


async def main(node: taskrpc.Node) -> None:
    client = node.create_client(Greet, "greet")
    response = await client.call(Greet.Request())
    print(response.greting)
    # mypy reports: "Greet_Response" has no attribute "greting"; maybe "greeting"?
    # pyright reports: Cannot access attribute "greting" for class "Greet_Response"
    await client.call(Add.Request())
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"
    await client.call(Greet.Response())
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "Greet_Response"; expected "Greet_Request"
    # pyright reports: …"Greet_Response" is not assignable to "Greet_Request"
    await client.call(Greet)
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "type[Greet]"; expected "Greet_Request"
    # pyright reports: Argument of type "type[Greet]" cannot be assigned to parameter…
    await client.call({"name": "Ada"})
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "dict[str, str]"; expected "Greet_Request"
    # pyright reports: Argument of type "dict[str, str]" cannot be assigned to parameter…
    await client.call(Greet.Request(), timeout="2 s")
    # mypy reports: Argument "timeout" to "call" of "Client" has incompatible type "str"; expected "float | Unset | None"
    # pyright reports: Argument of type "Literal['2 s']" cannot be assigned to parameter…
    await client.call(Greet.Request(nme="Ada"))
    # mypy reports: Unexpected keyword argument "nme" for "Greet_Request"; did you mean "name"?
    # pyright reports: No parameter named "nme"
    client.call_async(Add.Request())
    # mypy reports: Argument 1 to "call_async" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"
    print((await client.call_async(Greet.Request())).sum)
    # mypy reports: "Greet_Response" has no attribute "sum"
    # pyright reports: Cannot access attribute "sum" for class "Greet_Response"
    number: int = (await client.call(Greet.Request())).greeting
    # mypy reports: Incompatible types in assignment (expression has type "str", variable has type "int")
    # pyright reports: Type "str" is not assignable to declared type "int"

    loaded = node.create_client(Loaded, "greet")
    print((await loaded.call(Loaded.Request())).greting)
    # mypy reports: "Greet_Response" has no attribute "greting"; maybe "greeting"?
    # pyright reports: Cannot access attribute "greting" for class "Greet_Response"
    await loaded.call(Add.Request())
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"

    node.create_client(Spot, "greet")
    # mypy reports: Argument 1 to "create_client" of "Node" has incompatible type "type[Spot]"; expected "type[Srv[Any, Any]]"
    # pyright reports: …"Spot" is incompatible with protocol "Srv…
    node.create_client("my_interfaces/srv/Greet", "greet")
    # mypy reports: Argument 1 to "create_client" of "Node" has incompatible type "str"; expected "type[Srv[Any, Any]]"
    # pyright reports: Argument of type "Literal['my_interfaces/srv/Greet']" cannot be assigned to parameter…
    node.create_client(Greet.Request, "greet")
    # mypy reports: Argument 1 to "create_client" of "Node" has incompatible type "type[Greet_Request]"; expected "type[Srv[Any, Any]]"
    # pyright reports: …"Request" is incompatible with protocol "Srv…
    node.create_clint(Greet, "greet")
    # mypy reports: "Node" has no attribute "create_clint"; maybe "create_client"?
    # pyright reports: Cannot access attribute "create_clint" for class "Node"
    wrong: taskrpc.Client[Add.Request, Add.Response] = client
    # mypy reports: Incompatible types in assignment (expression has type "Client[Greet_Request, Greet_Response]", variable has type "Client[Add_Request, Add_Response]")
    # pyright reports: …Type parameter "RequestT@Client" is invariant, but "Greet_Request" is not the same as "Request"
    taskrpc.Nod("a")
    # mypy reports: Module has no attribute "Nod"; maybe "Node"?
    # pyright reports: "Nod" is not a known attribute of module "taskrpc"
    srvgen.lod("my_interfaces/srv/Greet")
    # mypy reports: Module has no attribute "lod"; maybe "load"?
    # pyright reports: "lod" is not a known attribute of module "srvgen"


def main_sync(node: sync.Node, client: sync.Client[Greet.Request, Greet.Response]) -> None:
    print(client.call(Greet.Request()).greting)
    # mypy reports: "Greet_Response" has no attribute "greting"; maybe "greeting"?
    # pyright reports: Cannot access attribute "greting" for class "Response"
    client.call(Add.Request())
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"
    client.call_async(Add.Request())
    # mypy reports: Argument 1 to "call_async" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"
    print(client.call_async(Greet.Request()).result().sum)
    # mypy reports: "Greet_Response" has no attribute "sum"
    # pyright reports: Cannot access attribute "sum" for class "Response"
    node.create_client(Loaded, "greet").call(Add.Request())
    # mypy reports: Argument 1 to "call" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"
    print(taskrpc.sync.Node("b").create_client(Greet, "greet").call(Greet.Request()).sum)
    # mypy reports: "Greet_Response" has no attribute "sum"
    # pyright reports: Cannot access attribute "sum" for class "Greet_Response"

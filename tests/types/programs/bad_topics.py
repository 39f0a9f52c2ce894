"""Wrong messages on topics, and callbacks of timers that expect arguments."""

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook()

from my_interfaces.msg import Spot
from my_interfaces.srv import Greet
from std_msgs.msg import String


def heard(message: String) -> None:
    print(message.dta)
    # mypy reports: "String" has no attribute "dta"; maybe "data"?
    # pyright reports: Cannot access attribute "dta" for class "String"


async def heard_slowly(message: String) -> None:
    print(message.data)


def main(node: taskrpc.Node, blocking: sync.Node) -> None:
    publisher = node.create_publisher(Spot, "spots")
    publisher.publish(String())
    # mypy reports: Argument 1 to "publish" of "Publisher" has incompatible type "String"; expected "Spot"
    # pyright reports: …"String" is not assignable to "Spot"
    publisher.publish(Spot)
    # mypy reports: Argument 1 to "publish" of "Publisher" has incompatible type "type[Spot]"; expected "Spot"
    # pyright reports: Argument of type "type[Spot]" cannot be assigned to parameter…
    node.create_subscription(Spot, "spots", heard)
    # mypy reports: Argument 3 to "create_subscription" of "Node" has incompatible type "Callable[[String], None]"; expected …
    # pyright reports: …"Spot" is not assignable to "String"
    node.create_subscription(Spot, "spots", heard_slowly)
    # mypy reports: Argument 3 to "create_subscription" of "Node" has incompatible type "Callable[[String], Coroutine[Any, Any, None]]"; expected …
    # pyright reports: …"Spot" is not assignable to "String"
    node.create_subscription(Spot, "spots", lambda spot: print(spot.z))
    # mypy reports: "Spot" has no attribute "z"
    # pyright reports: Cannot access attribute "z" for class "Spot"
    node.create_publisher(Greet, "spots")
    # mypy reports: Value of type variable "MsgT" of "create_publisher" of "Node" cannot be "Greet"
    # pyright reports: …"get_fields_and_field_types" is not present
    node.create_publisher("my_interfaces/msg/Spot", "spots")
    # mypy reports: Argument 1 to "create_publisher" of "Node" has incompatible type "str"; expected "type[Any]"
    # pyright reports: Argument of type "Literal['my_interfaces/msg/Spot']" cannot be assigned to parameter…
    node.create_timer(1.0, heard)
    # mypy reports: Argument 2 to "create_timer" of "Node" has incompatible type "Callable[[String], None]"; expected …
    # pyright reports: …Extra parameter "message"
    blocking.create_publisher(Spot, "spots").publish(String())
    # mypy reports: Argument 1 to "publish" of "Publisher" has incompatible type "String"; expected "Spot"
    # pyright reports: …"String" is not assignable to "Spot"
    blocking.create_subscription(Spot, "spots", heard)
    # mypy reports: Argument 3 to "create_subscription" of "Node" has incompatible type "Callable[[String], None]"; expected …
    # pyright reports: …"Spot" is not assignable to "String"
    blocking.create_timer(1.0, heard)
    # mypy reports: Argument 2 to "create_timer" of "Node" has incompatible type "Callable[[String], None]"; expected …
    # pyright reports: …Extra parameter "message"
    wrong: taskrpc.Publisher[String] = publisher
    # mypy reports: Incompatible types in assignment (expression has type "Publisher[Spot]", variable has type "Publisher[String]")
    # pyright reports: …Type parameter "MsgT@Publisher" is invariant, but "Spot" is not the same as "String"

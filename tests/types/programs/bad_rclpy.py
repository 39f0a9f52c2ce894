"""The same mistakes with rclpy's names."""

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy.action import ActionClient, ActionServer
from taskrpc.ros.packages.rclpy.action.server import ServerGoalHandle
from taskrpc.ros.packages.rclpy.node import Node

srvgen.install_import_hook()

from my_interfaces.action import Count
from my_interfaces.msg import Spot
from my_interfaces.srv import Add, Greet


def forgets(request: Greet.Request, response: Greet.Response) -> None:
    response.greeting = request.name


def heard(message: Greet.Request) -> None:
    print(message.name)


def count(goal: ServerGoalHandle[Count.Goal, Count.Result, Count.Feedback]) -> None:
    print(goal.request.tarket)
    # mypy reports: "Count_Goal" has no attribute "tarket"; maybe "target"?
    # pyright reports: Cannot access attribute "tarket" for class "…Goal"
    goal.succeed()


def act(node: Node) -> None:
    ActionServer(node, Count, "count", count)
    # mypy reports: Argument 4 to "ActionServer" has incompatible type "Callable[[ServerGoalHandle[Count_Goal, Count_Result, Count_Feedback]], None]"; expected …
    # pyright reports: …
    client = ActionClient(node, Count, "count")
    client.send_goal_async(Count.Result())
    # mypy reports: Argument 1 to "send_goal_async" of "ActionClient" has incompatible type "Count_Result"; expected "Count_Goal"
    # pyright reports: …


def main(node: Node) -> None:
    node.create_service(Greet, "greet", forgets)
    # mypy reports: Argument 3 to "create_service" of "Node" has incompatible type "Callable[[Greet_Request, Greet_Response], None]"; expected …
    # pyright reports: …Function return type "None" is incompatible…
    client = node.create_client(Greet, "greet")
    client.call_async(Add.Request())
    # mypy reports: Argument 1 to "call_async" of "Client" has incompatible type "Add_Request"; expected "Greet_Request"
    # pyright reports: …"Add_Request" is not assignable to "Greet_Request"
    response = client.call(Greet.Request())
    print(response.greeting)
    # mypy reports: Item "None" of "Greet_Response | None" has no attribute "greeting"
    # pyright reports: "greeting" is not a known attribute of "None"
    assert response is not None
    print(response.greting)
    # mypy reports: "Greet_Response" has no attribute "greting"; maybe "greeting"?
    # pyright reports: Cannot access attribute "greting" for class "Greet_Response"
    node.create_publisher(Spot, "spots", 10).publish(Greet.Request())
    # mypy reports: Argument 1 to "publish" of "Publisher" has incompatible type "Greet_Request"; expected "Spot | bytes"
    # pyright reports: …"Greet_Request" is not assignable to "Spot"
    node.create_subscription(Spot, "spots", heard, 10)
    # mypy reports: Argument 3 to "create_subscription" of "Node" has incompatible type "Callable[[Greet_Request], None]"; expected …
    # pyright reports: …"Spot" is not assignable to "Greet_Request"
    node.create_client(Spot, "greet")
    # mypy reports: Argument 1 to "create_client" of "Node" has incompatible type "type[Spot]"; expected "type[Srv[Any, Any]]"
    # pyright reports: …"Spot" is incompatible with protocol "Srv…
    rclpy.spin_onse(node)
    # mypy reports: Module has no attribute "spin_onse"; maybe "spin_once"?
    # pyright reports: "spin_onse" is not a known attribute of module "taskrpc.ros.packages.rclpy"

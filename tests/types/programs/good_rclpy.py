"""rclpy's names: nodes as tutorials write them."""

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy.action import ActionClient, ActionServer
from taskrpc.ros.packages.rclpy.action.server import ServerGoalHandle
from taskrpc.ros.packages.rclpy.node import Node
from taskrpc.ros.packages.rclpy.publisher import Publisher

srvgen.install_import_hook()

from my_interfaces.action import Count
from my_interfaces.msg import Spot
from my_interfaces.srv import Greet


class Greeter(Node):
    def __init__(self) -> None:
        super().__init__("greeter")
        self.service = self.create_service(Greet, "greet", self.greet)
        self.client = self.create_client(Greet, "other")
        self.spots: Publisher[Spot] = self.create_publisher(Spot, "spots", 10)
        self.create_subscription(Spot, "spots", self.heard, 10)
        self.create_subscription(Spot, "spots", self.heard_raw, 10, raw=True)
        self.create_timer(1.0, self.tick)
        self.counting = ActionServer(self, Count, "count", self.count)
        self.counter = ActionClient(self, Count, "count")

    async def greet(self, request: Greet.Request, response: Greet.Response) -> Greet.Response:
        answer = await self.client.call_async(request)
        return answer or response

    def heard(self, spot: Spot) -> None:
        self.get_logger().info(f"{spot.x}")

    def heard_raw(self, spot: bytes) -> None:
        self.get_logger().info(f"{len(spot)}")

    def count(
        self, goal: ServerGoalHandle[Count.Goal, Count.Result, Count.Feedback]
    ) -> Count.Result:
        goal.publish_feedback(Count.Feedback())
        goal.succeed()
        return Count.Result()

    async def ask(self) -> Count.Result | None:
        handle = await self.counter.send_goal_async(Count.Goal())
        response = await handle.get_result_async() if handle else None
        return response.result if response else None

    def tick(self) -> None:
        self.spots.publish(Spot(x=1.0))


rclpy.init()
rclpy.spin(Greeter())

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger


def move(name):
    def callback(request, response):
        print(name, "moves the arm")
        return Trigger.Response(success=True, message=name)

    return callback


rclpy.init()
node = Node("arms")
node.create_service(Trigger, "move_arm", move("the old server"))
node.create_service(Trigger, "move_arm", move("the new server"))

future = node.create_client(Trigger, "move_arm").call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future)
print("the response is from", future.result().message)
rclpy.spin_once(node, timeout_sec=0.5)

import random
import time

import rclpy
from std_msgs.msg import Bool

rclpy.init()
node = rclpy.create_node("pilot")
publisher = node.create_publisher(Bool, "pause", 10)
time.sleep(random.uniform(1.0, 5.0))
publisher.publish(Bool(data=True))
time.sleep(random.uniform(0.1, 0.4))
publisher.publish(Bool(data=False))
rclpy.spin(node)

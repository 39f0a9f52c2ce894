import time

import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("mapper")
publisher = node.create_publisher(String, "map", 10)
time.sleep(0.4)  # until the robot is there
publisher.publish(String(data="hall"))
rclpy.spin(node)

"""Calls the tools of ros-mcp as an assistant does, and prints what came back as JSON.

Argument: the port of the gateway.
"""

import asyncio
import json
import sys

from fastmcp import Client
from ros_mcp.main import mcp

port = int(sys.argv[1])


async def main():
    found = {}
    async with Client(mcp) as client:

        async def use(tool, **arguments):
            result = await client.call_tool(tool, arguments)
            return json.loads(result.content[0].text)

        found["connected"] = await use("connect_to_robot", ip="127.0.0.1", port=port)
        found["topics"] = await use("get_topics")
        found["topic"] = await use("get_topic_details", topic="/robot_task/pose")
        found["services"] = await use("get_services")
        found["service"] = await use("get_service_details", service="/robot_task")
        found["nodes"] = await use("get_nodes")
        found["node"] = await use("get_node_details", node="/task_server")
        found["message"] = await use("get_message_details", message_type="geometry_msgs/Pose")
        task = {"task_type": "move", "target": "warehouse", "priority": 8}
        found["submitted"] = await use(
            "call_service",
            service_name="/robot_task",
            service_type="my_robot_interfaces/srv/RobotTask",
            request=task,
        )
        found["unknown"] = await use(
            "call_service", service_name="/nothing", service_type="std_srvs/srv/Empty", request={}
        )
        found["pose"] = await use(
            "subscribe_once", topic="/robot_task/pose", msg_type="geometry_msgs/msg/PoseStamped"
        )
        found["published"] = await use(
            "publish_once", topic="/chatter", msg_type="std_msgs/msg/String", msg={"data": "hello"}
        )
        found["parameters"] = await use("get_parameters", node_name="/talker")
        found["set"] = await use("set_parameter", name="/talker:speed", value="2")
        found["parameter"] = await use("get_parameter", name="/talker:speed")
        found["has"] = await use("has_parameter", name="/talker:speed")
        found["actions"] = await use("get_actions")
    print(json.dumps(found))


asyncio.run(main())

"""Uses everything of roslibpy that programs use, and prints what came back as JSON.

Arguments: the port of the gateway, the transport (twisted or asyncio).
"""

import json
import sys
import threading
import time

import roslibpy

port, transport = int(sys.argv[1]), sys.argv[2]
roslibpy.set_default_transport(transport)
ADD = "example_interfaces/AddTwoInts"
found = {}


def connected():
    ros = roslibpy.Ros("127.0.0.1", port)
    ros.run(30)
    return ros


def call(ros, service, type_name, **request):
    target = roslibpy.Service(ros, service, type_name)
    try:
        return dict(target.call(roslibpy.ServiceRequest(request), timeout=30))
    except roslibpy.core.ServiceException as error:
        return f"{error}"


def add(request, response):
    response["sum"] = request["a"] + request["b"]
    return request["b"] >= 0


def until(condition):
    """Wait until a condition holds; what is printed shows if it never does."""
    end = time.monotonic() + 30
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)


def plain(result):
    return dict(result) if hasattr(result, "data") else result


ros, other = connected(), connected()
task = {"task_type": "move", "target": "warehouse", "priority": 8}
found["submitted"] = call(ros, "/robot_task", "my_robot_interfaces/RobotTask", **task)
found["unknown"] = call(ros, "/nothing", "std_srvs/Empty")

found["topics"] = ros.get_topics()
found["topicType"] = ros.get_topic_type("/robot_task/pose")
found["topicsForType"] = ros.get_topics_for_type("geometry_msgs/msg/PoseStamped")
found["services"] = ros.get_services()
found["serviceType"] = ros.get_service_type("/robot_task")
found["servicesForType"] = ros.get_services_for_type("my_robot_interfaces/RobotTask")
found["request"] = plain(ros.get_service_request_details("my_robot_interfaces/RobotTask"))
found["nodes"] = ros.get_nodes()
found["nodeServices"] = ros.get_node_details("/task_server")["services"]
found["params"] = ros.get_params()
found["definition"] = plain(ros.get_message_details("geometry_msgs/Pose"))
found["late"] = time.time() - ros.get_time().to_sec()
ros.set_param("/talker:speed", 2)
found["parameter"] = ros.get_param("/talker:speed")

server = roslibpy.Service(other, "/add_in_python", ADD)
server.advertise(add)
until(lambda: "/add_in_python" in ros.get_services())
found["sum"] = call(ros, "/add_in_python", ADD, a=2, b=3)
found["failed"] = call(ros, "/add_in_python", ADD, a=2, b=-3)
server.unadvertise()
until(lambda: "/add_in_python" not in ros.get_services())
found["gone"] = call(ros, "/add_in_python", ADD, a=2, b=3)

goal = roslibpy.Goal({"task_type": "move", "target": "warehouse", "priority": 9})
execute = roslibpy.ActionClient(ros, "/robot_task/execute", "my_robot_interfaces/ExecuteTask")
ends, reports, done = [], [], threading.Event()


def send(target, goal):
    """Send a goal; return its status, what came with it, and the number of feedback messages."""
    done.clear()
    ends.clear()
    reports.clear()

    def end(result):
        ends.append(result)
        done.set()

    target.send_goal(goal, end, reports.append, end)
    assert done.wait(30)
    return [ends[0]["status"].name, ends[0]["values"], len(reports)]


found["goal"] = send(execute, goal)
found["badGoal"] = send(execute, roslibpy.Goal({"priority": "high"}))
nothing = roslibpy.ActionClient(ros, "/nothing", "my_robot_interfaces/ExecuteTask")
found["noAction"] = send(nothing, goal)

got = []
listener = roslibpy.Topic(ros, "/chatter", "std_msgs/String", queue_length=10)
listener.subscribe(lambda message: got.append(message["data"]))
ros.get_topics()  # its response shows that the gateway has handled the message before it
talker = roslibpy.Topic(other, "/chatter", "std_msgs/String")
for text in ("one", "two", "Zürich ☃"):
    talker.publish(roslibpy.Message({"data": text}))
until(lambda: len(got) >= 3)
listener.unsubscribe()
ros.get_topics()  # its response shows that the gateway has handled the message before it
talker.publish(roslibpy.Message({"data": "late"}))
time.sleep(0.3)
found["chatter"] = got

print(json.dumps(found), flush=True)
ros.close()
other.close()
ros.terminate()

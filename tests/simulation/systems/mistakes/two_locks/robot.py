import threading
import time

from std_srvs.srv import Trigger

from taskrpc import sync

arm = threading.Lock()
gripper = threading.Lock()


def load(request, response):
    with arm:
        time.sleep(0.01)
        with gripper:
            print("loads")
    response.success = True
    return response


def unload(request, response):
    with gripper:
        time.sleep(0.01)
        with arm:
            print("unloads")
    response.success = True
    return response


with sync.Node("robot") as node:
    node.create_service(Trigger, "load", load)
    node.create_service(Trigger, "unload", unload)
    node.spin()

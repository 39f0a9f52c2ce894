import threading
import time

from example_interfaces.srv import AddTwoInts

from taskrpc import sync

arm = threading.Lock()


def move(request, response):
    with arm:
        print("begins")
        time.sleep(0.2)
        print("ends")
    response.sum = request.a + request.b
    return response


with sync.Node("robot") as node:
    node.create_service(AddTwoInts, "move", move, concurrency=2)
    node.spin()

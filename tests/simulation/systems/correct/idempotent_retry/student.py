import time

from example_interfaces.srv import AddTwoInts

import taskrpc
from taskrpc import sync


def switch_on(client, number):
    while True:
        try:
            client.call(AddTwoInts.Request(a=number), timeout=1.0)
            return
        except taskrpc.TaskRpcError as error:
            print(f"tries light {number} again after {type(error).__name__}")
            time.sleep(0.5)


with sync.Node("student") as node:
    client = node.create_client(AddTwoInts, "switch_on")
    for number in range(5):
        switch_on(client, number)
        print(f"light {number} is on")

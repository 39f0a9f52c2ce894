import time

from std_srvs.srv import SetBool

import taskrpc
from taskrpc import sync

ATTEMPTS = 3


def switch(client, on):
    for _ in range(ATTEMPTS):
        try:
            return client.call(SetBool.Request(data=on), timeout=0.2)
        except taskrpc.TaskRpcError as error:
            print(f"attempt failed: {type(error).__name__}")
    time.sleep(5.0)
    print("gives up")
    return None


with sync.Node("student") as node:
    client = node.create_client(SetBool, "light")
    client.wait_for_service()
    for number in range(10):
        switch(client, number % 2 == 0)
        time.sleep(0.5)

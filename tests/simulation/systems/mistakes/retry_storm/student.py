from std_srvs.srv import Trigger

import taskrpc
from taskrpc import sync

with sync.Node("student") as node:
    client = node.create_client(Trigger, "dock")
    client.wait_for_service()
    while True:
        try:
            client.call(Trigger.Request())
            break
        except taskrpc.TaskRpcError:
            continue
    print("is docked")

from std_srvs.srv import Trigger

from taskrpc import sync

with sync.Node("student") as node:
    client = node.create_client(Trigger, "battery", timeout=0.3)
    print(client.call(Trigger.Request()).message)

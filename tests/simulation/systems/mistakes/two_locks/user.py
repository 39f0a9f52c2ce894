import random
import sys
import time

from std_srvs.srv import Trigger

import taskrpc
from taskrpc import sync

with sync.Node("user_of_" + sys.argv[1]) as node:
    client = node.create_client(Trigger, sys.argv[1])
    client.wait_for_service()
    for _ in range(4):
        time.sleep(random.uniform(0.0, 0.2))
        try:
            client.call(Trigger.Request(), timeout=2.0)
        except taskrpc.DeadlineExceeded:
            print("no response")

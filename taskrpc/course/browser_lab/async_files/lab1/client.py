"""Lab 1, asynchronous: calls the service, for example: client.py 2 3"""

import sys

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


async def main():
    a, b = int(sys.argv[1]), int(sys.argv[2])
    async with taskrpc.Node("add_client") as node:
        client = node.create_client(AddTwoInts, "@SERVICE@")
        # 6. Wait until a server offers it: await client.wait_for_service()
        # 7. Send the request: response = await client.call(AddTwoInts.Request(a=a, b=b))
        print(f"{a} + {b} = {response.sum}")


taskrpc.run(main())

"""Lab 1, asynchronous: a service that adds two integers."""

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


async def add(request, response):
    # 1. Put the sum of request.a and request.b into response.sum.
    # 2. Print a line with both numbers.
    # 3. What does a callback have to do at its end?
    pass


async def main():
    async with taskrpc.Node("add_server") as node:
        # 4. Create the service "@SERVICE@" with node.create_service(type, name, callback).
        # 5. Let the node run: await node.spin()
        pass


taskrpc.run(main())

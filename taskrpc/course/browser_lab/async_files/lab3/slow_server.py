"""Lab 3, asynchronous: a service that needs one second for each sum. Change nothing here."""

import asyncio

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
SECONDS = 1.0


async def add(request, response):
    print(f"begins {request.a} + {request.b}")
    await asyncio.sleep(SECONDS)
    response.sum = request.a + request.b
    return response


async def main():
    async with taskrpc.Node("slow_server") as node:
        node.create_service(AddTwoInts, "@SERVICE@", add, concurrency=10)
        print("the server is ready")
        await node.spin()


taskrpc.run(main())

"""Programs of small scenarios: a robot and its client, for taskrpc and for rclpy."""

ROBOT = """
    import asyncio, srvgen, taskrpc

    AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")

    async def main():
        async with taskrpc.Node("robot") as node:
            def pick(request, response):
                print("picked", request.a)
                response.sum = request.a + request.b
                return response
            node.create_service(AddTwoInts, "pick", pick)
            await node.spin()

    asyncio.run(main())
    """
CLIENT = """
    import asyncio, srvgen, taskrpc

    AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")

    async def main():
        async with taskrpc.Node("client") as node:
            client = node.create_client(AddTwoInts, "pick")
            await client.wait_for_service(None)
            for number in range(3):
                try:
                    response = await client.call(AddTwoInts.Request(a=number), timeout=1.0)
                    print("answer", response.sum)
                except taskrpc.TaskRpcError as error:
                    print("failed", number, type(error).__name__)

    asyncio.run(main())
    """
ROS_ROBOT = """
    import rclpy
    from example_interfaces.srv import AddTwoInts
    from rclpy.node import Node

    class Robot(Node):
        def __init__(self):
            super().__init__("robot")
            self.create_service(AddTwoInts, "pick", self.pick)

        def pick(self, request, response):
            self.get_logger().info(f"picked {request.a}")
            response.sum = request.a + request.b
            return response

    rclpy.init()
    rclpy.spin(Robot())
    """
ROS_CLIENT = """
    import rclpy
    from example_interfaces.srv import AddTwoInts
    from rclpy.node import Node

    rclpy.init()
    node = Node("client")
    client = node.create_client(AddTwoInts, "pick")
    while not client.wait_for_service(timeout_sec=1.0):
        node.get_logger().info("waiting")
    for number in range(3):
        future = client.call_async(AddTwoInts.Request(a=number))
        rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
        node.get_logger().info(f"answer {future.result().sum}" if future.done() else "no answer")
    node.destroy_node()
    rclpy.shutdown()
    """

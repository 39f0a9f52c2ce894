"""A client's channel notices every change of the server, whenever the change arrives."""

import taskrpc
from taskrpc.wire.frames import FrameType, pack_frame
from tests.taskrpc.transport.helpers import Add, add, ask


async def test_change_that_arrives_with_the_answer_to_resolve_makes_the_client_resolve_again():
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "first", add)
        server.create_service(Add, "add", add)
        first = node.create_client(Add, "first")
        assert await first.wait_for_service(1)
        (serving,) = server._transport._served
        asking = first._channel._connection
        asked, answers = [], []
        write_request, write_answer = asking.transport.write, serving.transport.write

        def recorded(data):
            asked.append(data[4])
            write_request(data)

        def with_a_change(data):
            answers.append(data[4])
            if answers == [FrameType.RESPONSE]:
                data = bytes(data) + pack_frame(FrameType.ADVERTISE, 0, 0, 0, 0)
            write_answer(data)

        asking.transport.write, serving.transport.write = recorded, with_a_change
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(1)
        assert asked.count(FrameType.RESOLVE) == 2
        assert (await client.call(ask(1, 2))).sum == 3

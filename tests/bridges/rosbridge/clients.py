"""A client of rosbridge without a connection: a session and what it has sent."""

import asyncio
import contextlib
import json

import taskrpc
from taskrpc.bridges.rosbridge.session import Bridge, Session


class Client:
    """Sends operations to a session and reads what it sends."""

    def __init__(self, bridge):
        self.sent = []
        self.behind = False
        self.session = Session(bridge, self._sent, lambda: self.behind)
        self._news = asyncio.Event()

    def _sent(self, text):
        self.sent.append(json.loads(text))
        self._news.set()

    async def send(self, op, **fields):
        await self.session.receive(json.dumps({"op": op, **fields}))

    async def next(self, **wanted):
        """Take the next thing that was sent; skip what does not have the wanted fields."""
        while True:
            while self.sent:
                found = self.sent.pop(0)
                if all(found.get(name) == value for name, value in wanted.items()):
                    return found
            self._news.clear()
            await asyncio.wait_for(self._news.wait(), 600)

    async def call(self, service, args=None, **fields):
        await self.send("call_service", id="call", service=service, args=args, **fields)
        return await self.next(op="service_response")


@contextlib.asynccontextmanager
async def connected(count=1, program=(), gateway=()):
    """A node of a program, and clients of one bridge; the options are those of the two nodes."""
    bridge_node = taskrpc.Node("rosbridge", transport="memory", **dict(gateway))
    async with taskrpc.Node("program", transport="memory", **dict(program)) as node, bridge_node:
        bridge = Bridge(bridge_node)
        clients = [Client(bridge) for _ in range(count)]
        try:
            yield node, *clients
        finally:
            for client in clients:
                client.session.close()

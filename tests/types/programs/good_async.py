"""Every way to make and use a service, a client and a topic without blocking."""

import asyncio
from typing import TypeVar

import srvgen
import taskrpc

srvgen.install_import_hook()

from my_interfaces.msg import Spot
from my_interfaces.srv import Add, Greet
from std_msgs.msg import String

RequestT = TypeVar("RequestT", bound=taskrpc.Msg)
ResponseT = TypeVar("ResponseT", bound=taskrpc.Msg)

Loaded = srvgen.load("my_interfaces/srv/Greet")


def greet(request: Greet.Request, response: Greet.Response) -> Greet.Response:
    response.greeting = request.name * request.times
    return response


async def greet_slowly(request: Greet.Request, response: Greet.Response) -> Greet.Response:
    await asyncio.sleep(1)
    return greet(request, response)


def remember(
    request: Greet.Request, response: Greet.Response
) -> taskrpc.Effect[Greet.Response] | Greet.Response:
    if not request.name:
        return response
    return taskrpc.Effect(response, [("INSERT INTO names VALUES (?)", (request.name,))])


async def remember_slowly(
    request: Greet.Request, response: Greet.Response
) -> taskrpc.Effect[Greet.Response]:
    return taskrpc.Effect(response, lambda: print(request.name))


def take(call: taskrpc.DeferredCall[Add.Request, Add.Response]) -> None:
    call.reply(Add.Response(sum=call.request.a + call.request.b))


class Unknown:
    """Bare classes are those of unknown messages."""

    client: taskrpc.Client
    publisher: taskrpc.Publisher
    subscription: taskrpc.Subscription
    srv_type: type[taskrpc.Srv]

    async def greeting(self, call: taskrpc.DeferredCall) -> str:
        response = await self.client.call(call.request)
        return str(response.greeting)

    def effect(self, response: Greet.Response) -> taskrpc.Effect:
        return taskrpc.Effect(response, [])


def heard(message: String) -> None:
    print(message.data.upper())


async def heard_slowly(message: String) -> None:
    print(message.data.upper())


def tick() -> None:
    print(taskrpc.current_call())


class Greeter:
    def __init__(self, node: taskrpc.Node) -> None:
        self.client: taskrpc.Client[Greet.Request, Greet.Response] = node.create_client(
            Greet, "greet"
        )
        self.spots: taskrpc.Publisher[Spot] = node.create_publisher(Spot, "spots")
        self.service: taskrpc.Service = node.create_service(Greet, "greet", self.greet)

    async def greet(self, request: Greet.Request, response: Greet.Response) -> Greet.Response:
        return await self.client.call(request, timeout=1.0)


async def ask(
    node: taskrpc.Node, srv_type: type[taskrpc.Srv[RequestT, ResponseT]], request: RequestT
) -> ResponseT:
    return await node.create_client(srv_type, "ask").call(request)


async def main() -> None:
    async with taskrpc.Node("a") as node:
        node.create_service(Greet, "greet", greet)
        node.create_service(Greet, "greet", greet_slowly, concurrency=4)
        node.create_service(Greet, "greet", lambda request, response: response)
        store = taskrpc.MemoryCompletions()
        node.create_service(Greet, "greet", remember, exactly_once=store)
        node.create_service(Greet, "greet", remember_slowly, exactly_once=store)
        node.create_deferred_service(Add, "add", take)

        client = node.create_client(Greet, "greet", retry=taskrpc.RetryPolicy())
        response = await client.call(Greet.Request(name="Ada", times=2), timeout=2.0)
        words: list[str] = response.greeting.split()
        future: asyncio.Future[Greet.Response] = client.call_async(Greet.Request())
        words += (await future).greeting.split()
        loaded = node.create_client(Loaded, "greet")
        words += (await loaded.call(Loaded.Request(name="Ada"))).greeting.split()
        total: int = (await ask(node, Add, Add.Request(a=1))).sum
        both = await asyncio.gather(loaded.call(Loaded.Request()), client.call(Greet.Request()))
        print(words, total, both[0].greeting)

        node.create_publisher(String, "chatter", 1).publish(String(data="a"))
        node.create_subscription(String, "chatter", heard)
        node.create_subscription(String, "chatter", heard_slowly, taskrpc.QoS(1))
        node.create_subscription(String, "chatter", lambda message: print(message.data))
        timer: taskrpc.Timer = node.create_timer(1.0, tick)
        timer.cancel()

    async with taskrpc.testing.connected_nodes("one", "other") as (one, other):
        one.create_service(Greet, "greet", greet)
        print((await other.create_client(Greet, "greet").call(Greet.Request())).greeting)


async def with_untyped(name: str) -> None:
    """Without stubs for a type, everything goes."""
    unknown = srvgen.load(name)
    async with taskrpc.Node("b") as node:
        client = node.create_client(unknown, "anything")
        print((await client.call(unknown.Request(what=1))).that)
        node.create_service(unknown, "anything", lambda request, response: response)


taskrpc.run(main())

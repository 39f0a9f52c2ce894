"""Every way to make and use a service, a client and a topic with calls that block."""

from concurrent.futures import Future

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook()

from my_interfaces.msg import Spot
from my_interfaces.srv import Add, Greet

Loaded = srvgen.load("my_interfaces/Greet")


def greet(request: Greet.Request, response: Greet.Response) -> Greet.Response:
    response.greeting = request.name
    return response


def take(call: taskrpc.DeferredCall[Add.Request, Add.Response]) -> None:
    call.fail(taskrpc.HandlerFailed("no_numbers", "expected numbers"))


def heard(spot: Spot) -> None:
    print(spot.x + spot.y)


def greeting_of(client: sync.Client[Greet.Request, Greet.Response], name: str) -> str:
    return client.call(Greet.Request(name=name)).greeting


with sync.Node("a") as node:
    node.create_service(Greet, "greet", greet, idempotent=True)
    node.create_deferred_service(Add, "add", take)
    client = node.create_client(Loaded, "greet")
    print(client.call(Loaded.Request(name="Ada"), 1.0).greeting.upper(), greeting_of(client, "Bob"))
    future: Future[Greet.Response] = client.call_async(Greet.Request())
    print(future.result(timeout=1).greeting)
    spots: sync.Publisher[Spot] = node.create_publisher(Spot, "spots")
    spots.publish(Spot(x=1.0))
    node.create_subscription(Spot, "spots", heard)
    node.create_timer(1.0, lambda: spots.publish(Spot()))
    node.spin()

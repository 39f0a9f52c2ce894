"""A program that uses pyzeros: `pyzeros_program.py PORT ACTION NAME`.

`pyzeros_program.py compile` compiles what pyzeros needs, and keeps it in the working folder.
"""

from __future__ import annotations

import asyncio
import json
import sys

import pyzeros
import zenoh
from pyzeros.builtin_msgs import Attachment
from ros2_pyterfaces.cyclone.std_msgs.msg import String
from ros2_pyterfaces.cyclone.std_srvs.srv import SetBool


def say(value):
    print(json.dumps(value), flush=True)


async def ready(received):
    """Yield what arrives; say "ready" when pyzeros takes it: what came before would be dropped."""
    first = asyncio.ensure_future(anext(received))
    await asyncio.sleep(0)  # the listener starts
    say("ready")
    yield await first
    async for each in received:
        yield each


async def reachable(server):
    """Wait until another session can call the server: pyzeros shows a server before that."""
    with open_session() as session:
        complete = zenoh.QueryTarget.ALL_COMPLETE
        querier = session.declare_querier(server.service_keyexpr, target=complete)
        while not querier.matching_status.matching:
            await asyncio.sleep(0.01)


async def serve(name):
    server = pyzeros.Server(SetBool, name)
    await reachable(server)
    async for responder in ready(server.listen_reliable()):
        responder.response.success = responder.request.data
        responder.response.message = "from pyzeros"
        responder.send()


async def call(name):
    client = pyzeros.Client(SetBool, name)
    await client.wait_for_service()
    response = await client.call_async(SetBool.Request(data=True))
    say([bool(response.success), response.message])


async def publish(name):
    publisher = pyzeros.Pub(String, name)
    say("ready")
    while True:
        publisher.publish(String(data="from pyzeros"))
        await asyncio.sleep(0.05)


async def listen(name):
    subscriber = pyzeros.Sub(String, name)
    async for message in ready(subscriber.listen_reliable()):
        say(message.data)


def compile_messages():
    """Use the compiled code once, so that it is ready; without it, a C compiler runs first."""
    Attachment.deserialize(bytes((0, 1, 0, 0)) + Attachment().serialize()[4:])


def open_session():
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{sys.argv[1]}"]))
    return zenoh.open(config)


def main():
    compile_messages()
    if sys.argv[1:] == ["compile"]:
        return
    action, name = sys.argv[2:]
    session = open_session()
    with pyzeros.auto_context(node="pyzeros", zenoh_session=session, namespace="/foreign"):
        asyncio.run(globals()[action](name))


if __name__ == "__main__":
    main()

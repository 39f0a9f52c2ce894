"""taskrpc without async: the blocking client, and the plain server of `taskrpc_tcp`."""

from __future__ import annotations

import taskrpc.sync
from benchmarks.contenders.taskrpc_tcp import Add, Echo, serve
from benchmarks.harness.contender import Caller


def connect(place: str, options: list[str]) -> Caller:
    node = taskrpc.sync.Node("caller")
    node.__enter__()
    adder, echoer = node.create_client(Add, "add"), node.create_client(Echo, "echo")
    for client in (adder, echoer):
        if not client.wait_for_service(timeout=10):
            raise RuntimeError(f"{client.service_name} is not there")
    return Caller(
        add=lambda a, b: adder.call(Add.Request(a=a, b=b)),
        echo=lambda data: echoer.call(Echo.Request(data=data)),
        sum_in=lambda response: response.sum,
        data_in=lambda response: response.data,
    )


__all__ = ["connect", "serve"]

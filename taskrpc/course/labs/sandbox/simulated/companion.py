"""The program that is simulated beside the submission's: the service and calls of the checks."""

from __future__ import annotations

import asyncio
from typing import Any

import srvgen
import taskrpc
from taskrpc.course.labs.sandbox.simulated import process
from taskrpc.course.labs.sandbox.simulated.messages import Answered, Asked, MessageType, Planned

_WAIT = 30.0
"""Seconds that the program has to offer its services."""
_ANSWERED = 1000.0
"""Seconds until a call fails: longer than any run."""


def _class_of(wanted: MessageType) -> Any:
    return srvgen.define(wanted.name, wanted.text) if wanted.text else srvgen.load(wanted.name)


async def main() -> None:
    """Offer the service and make the calls of the plan."""
    plan, link = process.plan, process.link
    async with taskrpc.Node("check") as node:
        if plan.service is not None:
            srv_type = _class_of(plan.service.type)

            async def respond(request: Any, response: Any) -> Any:
                data = link.ask(Asked(link.now(), srvgen.to_cdr(request))).response
                if data is None:
                    return await asyncio.Future()  # never done
                return srvgen.from_cdr(srv_type.Response, data)

            node.create_service(srv_type, plan.service.name, respond, concurrency=1000)
        clients = [node.create_client(_class_of(each.type), each.name) for each in plan.calls]
        for client in clients:
            await client.wait_for_service(timeout=_WAIT)

        async def call(number: int, planned: Planned) -> None:
            await asyncio.sleep(planned.at)
            request = srvgen.from_cdr(_class_of(planned.type).Request, planned.request)
            began = link.now()
            try:
                response = await clients[number].call(request, timeout=_ANSWERED)
            except taskrpc.TaskRpcError as error:
                link.tell(Answered(number, began, link.now(), None, str(error)))
            else:
                link.tell(Answered(number, began, link.now(), srvgen.to_cdr(response)))

        await asyncio.gather(*(call(*each) for each in enumerate(plan.calls)))
        await asyncio.Event().wait()


taskrpc.run(main())

"""`taskrpc view` on a laptop that has joined a lab: prints the links of the lab's live page."""

from __future__ import annotations

import asyncio
import re
import ssl
import sys

import srvgen
from taskrpc.cli.shared.command import Exit, NotFound, hinted
from taskrpc.cli.shared.remote import Remote
from taskrpc.cli.shared.robots import task_service
from taskrpc.course.classroom.authority import fingerprint
from taskrpc.course.classroom.joining import TIMEOUT, visit_now
from taskrpc.errors import TaskRpcError
from taskrpc.spi import Lab, join_address, split_address

_ADDRESS = re.compile(r"https://((?:[A-Za-z0-9.-]+|\[[0-9A-Fa-f:.]+\]):[0-9]{1,5})\Z")


def view_lab(lab: Lab) -> Exit:
    """Print the links of the lab's page. Raises TaskRpcError if there is no such page."""
    offered = {each.name for each in visit_now(lab).services}
    page_service = f"{task_service(lab.robot_namespace)}/page"
    if page_service not in offered:
        problem = NotFound(f"the lab at {lab.address} serves no live page for laptops")
        how = "the lecturer starts one: taskrpc classroom --web 0.0.0.0:8443 --serve"
        raise hinted(problem, f"{how}. For a robot of your own: taskrpc-server --web 127.0.0.1:0")
    address = _checked(lab, asyncio.run(_address(lab, page_service)))
    link, secret = f"https://{address}/", f"#view={lab.token}"
    for line in (
        f"the live page of the lab at {lab.address}, for {lab.token.partition('.')[0]}",
        "the links contain your secret: open one yourself, and show it to nobody",
        "the browser warns, because it does not know the lab's certificate; continue if the"
        " certificate's SHA-256 fingerprint is",
        fingerprint(lab.certificate).hex(":").upper(),
    ):
        print(line, file=sys.stderr, flush=True)
    print(f"look:      {link}{secret}")
    print(f"projector: {link}?projector{secret}", flush=True)
    return Exit.DONE


async def _address(lab: Lab, page_service: str) -> str:
    """Ask the lab's server for the address of its page."""
    trigger = srvgen.load("std_srvs/srv/Trigger")
    async with Remote(lab.address).node() as node:
        client = node.create_client(trigger, page_service, timeout=TIMEOUT)
        response = await client.call(trigger.Request())
    return str(response.message)


def _checked(lab: Lab, url: str) -> str:
    """Return `HOST:PORT` of the page, at an address that shows the lab's certificate.

    The browser of the laptop will send the account's secret there. Raises TaskRpcError.
    """
    found = _ADDRESS.match(url)
    if found is None:
        raise TaskRpcError(
            f"the lab at {lab.address}: expected the page's address, got {url[:80]!r}"
        )
    host, port = split_address(found[1])
    reached = split_address(lab.address)[
        0
    ]  # the laptop may reach the lab at another of its addresses
    for address in dict.fromkeys((join_address(reached, port), join_address(host, port))):
        try:
            shown = ssl.get_server_certificate(split_address(address), timeout=TIMEOUT)
        except OSError:  # includes TLS errors and timeouts
            continue
        if fingerprint(shown) == fingerprint(lab.certificate):
            return address
    problem = f"the lab's page at https://{join_address(host, port)}/ cannot be reached from here"
    raise hinted(
        TaskRpcError(problem), f"`taskrpc doctor {join_address(reached, port)}` finds out why"
    )

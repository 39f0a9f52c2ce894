"""HTTP with JSON bodies, as a web service would have it; the echo carries plain bytes."""

from __future__ import annotations

import asyncio

from aiohttp import ClientSession, ClientTimeout, TCPConnector, web

from benchmarks.harness.contender import Announce, Caller


async def _add(request: web.Request) -> web.Response:
    pair = await request.json()
    return web.json_response({"sum": pair["a"] + pair["b"]})


async def _echo(request: web.Request) -> web.Response:
    return web.Response(body=await request.read())


async def serve(announce: Announce, options: list[str]) -> None:
    app = web.Application(client_max_size=64 * 1024 * 1024)
    app.add_routes([web.post("/add", _add), web.post("/echo", _echo)])
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    host, port = runner.addresses[0][:2]
    announce(f"http://{host}:{port}")
    await asyncio.get_running_loop().create_future()


async def connect(place: str, options: list[str]) -> Caller:
    session = ClientSession(connector=TCPConnector(limit=0), timeout=ClientTimeout(total=60))

    async def add(a: int, b: int) -> int:
        async with session.post(f"{place}/add", json={"a": a, "b": b}) as response:
            return int((await response.json())["sum"])

    async def echo(data: bytes) -> bytes:
        async with session.post(f"{place}/echo", data=data) as response:
            return await response.read()

    return Caller(add, echo)

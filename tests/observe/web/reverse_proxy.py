"""A small reverse proxy: forwards requests, event streams and WebSockets to another server."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import aiohttp
from aiohttp import WSMsgType, web

_OF_A_CONNECTION = {"host", "connection", "upgrade", "transfer-encoding", "content-length"}


@asynccontextmanager
async def reverse_proxy(url, *, host=""):
    """Serve what the server at `url` serves; yields the proxy's own `HOST:PORT`.

    The server gets the Host header of the browser, or `host`.
    """

    def sent(request):
        kept = {
            name: value
            for name, value in request.headers.items()
            if name.lower() not in _OF_A_CONNECTION and not name.startswith("Sec-WebSocket")
        }
        return {**kept, "Host": host or request.headers["Host"]}

    async def forward(request):
        if request.headers.get("Upgrade", "").lower() == "websocket":
            return await socket(request)
        body, path = await request.read(), f"{url}{request.path_qs}"
        async with http.request(request.method, path, headers=sent(request), data=body) as got:
            response = web.StreamResponse(status=got.status)
            response.content_type = got.content_type
            await response.prepare(request)
            async for part in got.content.iter_any():
                await response.write(part)
            return response

    async def socket(request):
        try:
            upstream = await http.ws_connect(f"{url}{request.path_qs}", headers=sent(request))
        except aiohttp.WSServerHandshakeError as refused:
            return web.Response(status=refused.status)
        downstream = web.WebSocketResponse()
        await downstream.prepare(request)

        async def copy(source, target):
            async for message in source:
                if message.type is WSMsgType.TEXT:
                    await target.send_str(message.data)
            await target.close()

        await asyncio.gather(copy(upstream, downstream), copy(downstream, upstream))
        return downstream

    async with aiohttp.ClientSession(auto_decompress=False) as http:
        runner = web.ServerRunner(web.Server(forward), shutdown_timeout=0.1)
        await runner.setup()
        try:
            site = web.TCPSite(runner, "127.0.0.1", 0)
            await site.start()
            yield "127.0.0.1:{1}".format(*runner.addresses[0])
        finally:
            await runner.cleanup()

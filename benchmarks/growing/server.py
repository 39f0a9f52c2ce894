"""A server in a process of its own, which tells its memory, and the client's end of it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator

import taskrpc
from benchmarks.contenders import raw_asyncio
from benchmarks.contenders.taskrpc_tcp import offer
from benchmarks.harness import usage
from benchmarks.harness.limits import open_files


class Server:
    """The other process."""

    def __init__(self, process: asyncio.subprocess.Process, place: str) -> None:
        self._process = process
        self.place = place

    async def memory(self) -> int:
        """The bytes that it has for itself."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(b"\n")
        return int(await self._process.stdout.readline())


@contextlib.asynccontextmanager
async def started(kind: str = "taskrpc") -> AsyncIterator[Server]:
    """A server of `add` and `echo`, as long as the block runs; `raw` is bare asyncio's."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", __name__, kind, stdin=pipe, stdout=pipe
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield Server(process, json.loads(await process.stdout.readline()))
    finally:
        process.stdin.close()
        await process.wait()


async def _serve_raw() -> None:
    serving = asyncio.ensure_future(
        raw_asyncio.serve(lambda place, *_: print(json.dumps(place), flush=True), [])
    )
    await asyncio.to_thread(sys.stdin.readline)
    serving.cancel()


async def _serve() -> None:
    async with taskrpc.Node("server") as node:
        offer(node, [])
        print(json.dumps(node.address), flush=True)
        while await asyncio.to_thread(sys.stdin.readline):
            print(usage.memory(), flush=True)


if __name__ == "__main__":
    open_files()
    asyncio.run(_serve_raw() if sys.argv[1] == "raw" else _serve())

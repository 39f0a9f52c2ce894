"""The server of a class: the addresses at which laptops reach it, stored in the class's folder."""

from __future__ import annotations

from pathlib import Path

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.spi import private_files


class ClassServer(msgspec.Struct, frozen=True):
    """Where laptops reach the server of a class, and how many robots it has."""

    hosts: tuple[str, ...]
    """Names or addresses, the most probable one first."""
    port: int
    domain: int = 0
    robots: int = 1
    """The students are distributed among so many robots."""

    @property
    def addresses(self) -> tuple[str, ...]:
        """`HOST:PORT`, with brackets around IPv6 addresses."""
        shown = (f"[{host}]" if ":" in host else host for host in self.hosts)
        return tuple(f"{host}:{self.port}" for host in shown)


def read_server(file: Path) -> ClassServer:
    """Return the server of a class. Raises TaskRpcError if there is no class yet."""
    try:
        return msgspec.json.decode(file.read_bytes(), type=ClassServer)
    except FileNotFoundError:
        raise TaskRpcError("there is no class yet: `taskrpc classroom` makes one") from None
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise TaskRpcError(f"{file}: {error}") from None


def write_server(file: Path, server: ClassServer) -> None:
    """Store the server of a class; later programs of the class use its port and addresses."""
    private_files.write_private(file, msgspec.json.encode(server))

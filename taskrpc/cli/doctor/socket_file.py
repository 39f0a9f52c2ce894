"""Is anyone there: what `taskrpc doctor` finds out about one unix:/path."""

from __future__ import annotations

import asyncio
import os
import stat
import sys

from taskrpc.cli.doctor.findings import Finding, ok, problem
from taskrpc.transport.tcp.unix_sockets import path_of

_OTHERS = "only programs of its own user can call there: log in as that user, or listen at a port"


async def reach(place: str, patience: float) -> Finding:
    """Whether a program accepts connections at a socket's file, or why not."""
    path = path_of(place)
    if found := _wrong_file(path, place):
        return found
    if sys.platform != "win32":  # where `path_of` has refused the place
        try:
            async with asyncio.timeout(patience):
                _, writer = await asyncio.open_unix_connection(path)
        except OSError as error:
            return _no_connection(error, path, place, patience)
        writer.close()
    return ok(f"a program listens at {path}")


def _wrong_file(path: str, place: str) -> Finding | None:
    try:
        found = os.stat(path)
    except PermissionError:
        return problem(f"this user may not look into {os.path.dirname(path)}", _OTHERS)
    except OSError as error:
        advice = f"check the path, or start the server there with --listen {place}"
        return problem(f"there is no socket at {path}: {error.strerror}", advice)
    if not stat.S_ISSOCK(found.st_mode):
        return problem(f"{path} is no socket", "give the path with which the server was started")
    return None


def _no_connection(error: OSError, path: str, place: str, patience: float) -> Finding:
    if isinstance(error, ConnectionRefusedError):
        return problem(
            f"nobody listens at {path}: the server that made it has died",
            f"start it again with --listen {place}",
        )
    if isinstance(error, PermissionError):
        return problem(f"the socket {path} is another user's", _OTHERS)
    if isinstance(error, TimeoutError):
        return problem(
            f"the server at {path} took no connection within {patience:g} s",
            "see its log; if it hangs, end it with `taskrpc stop`",
        )
    return problem(f"{path} cannot be reached: {error.strerror or error}", "check the path")

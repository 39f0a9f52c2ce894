"""The lab that this user has joined: where its server is, and what it takes to be let in."""

from __future__ import annotations

import msgspec

from taskrpc import platform
from taskrpc.errors import TaskRpcError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

_FILE = "lab.json"


class Lab(msgspec.Struct, frozen=True, kw_only=True):
    """A server elsewhere that programs of this user call without being told."""

    place: str
    """`HOST:PORT`."""
    token: str
    """`NAME.SECRET` of this user's account there."""
    certificate: str
    """The very one that the server shows (PEM)."""
    domain: int = 0
    namespace: str = "/"
    """Of this user's nodes that say none."""
    expires: float = 0.0
    """Seconds since 1970 from when on the account is refused, 0.0 for never."""

    def __repr__(self) -> str:
        # Without the token: what is printed ends in logs.
        return f"Lab(place={self.place!r}, domain={self.domain}, namespace={self.namespace!r})"


def lab_file() -> Path:
    """Where it is remembered."""
    return platform.find_state_dir() / _FILE


def remembered_lab() -> Lab | None:
    """The lab that this user has joined, None where there is none.

    Raises TaskRpcError for a file that says something else.
    """
    path = lab_file()
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise TaskRpcError(f"{path}: {error.strerror}") from None
    try:
        return msgspec.json.decode(content, type=Lab)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise TaskRpcError(f"{path}: {error}; `taskrpc join --leave` removes it") from None


def remember_lab(lab: Lab) -> None:
    """Let every later program of this user call this lab, instead of the one before."""
    platform.state_dir()
    platform.write_private(lab_file(), msgspec.json.encode(lab))


def forget_lab() -> bool:
    """Call no lab any more; False where none was joined."""
    try:
        lab_file().unlink()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True

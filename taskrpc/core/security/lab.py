"""The lab that this user has joined: the address of its server, and this user's account there."""

from __future__ import annotations

import msgspec

from taskrpc.core.system import folders, private_files
from taskrpc.errors import TaskRpcError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

_FILE = "lab.json"


class Lab(msgspec.Struct, frozen=True, kw_only=True):
    """A server on another machine that this user's programs call by default."""

    address: str
    """`HOST:PORT`."""
    token: str
    """`NAME.SECRET` of this user's account there."""
    certificate: str
    """The server's own certificate (PEM); clients accept no other."""
    domain: int = 0
    namespace: str = "/"
    """The namespace of this user's nodes that give none."""
    expires: float = 0.0
    """When the account expires, in seconds since 1970; 0.0: never."""

    @property
    def robot_namespace(self) -> str:
        """The namespace of this user's robot: `/robot2` for `/robot2/ada`, `/` for `/ada`."""
        return self.namespace.rpartition("/")[0] or "/"

    def __repr__(self) -> str:
        # Without the token, which must not appear in logs.
        return f"Lab(address={self.address!r}, domain={self.domain}, namespace={self.namespace!r})"


def robot_namespace(number: int) -> str:
    """Return the namespace of a lab's robot, counted from 1: the first one has the root's."""
    return "/" if number == 1 else f"/robot{number}"


def lab_file() -> Path:
    """Return the path of the file that stores the joined lab."""
    return folders.find_state_dir() / _FILE


def remembered_lab() -> Lab | None:
    """Return the lab that this user has joined, None if there is none.

    Raises TaskRpcError if the file cannot be read or is invalid.
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
    """Store the lab, in the place of an earlier one; programs that start later call it."""
    folders.state_dir()
    private_files.write_private(lab_file(), msgspec.json.encode(lab))


def forget_lab() -> bool:
    """Remove the stored lab; returns False if this user had joined none."""
    try:
        lab_file().unlink()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True

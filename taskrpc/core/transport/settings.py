"""What a program says about its network: the settings that a transport is opened with."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from taskrpc.core.security.lab import Lab
from taskrpc.core.security.roles import Accounts
from taskrpc.core.security.tls import Tls
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.core.security.accounts import AccountSource

_MAX_DOMAIN = 232
"""The largest domain id that ROS 2 allows."""


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of a node that concern its transport; nodes with equal ones share it.

    A transport may ignore a setting that has no meaning for it.
    """

    domain: int
    listen: str | None = None
    """Where to accept calls."""
    peers: tuple[str, ...] = ()
    """Addresses to call, instead of the programs that the transport finds."""
    token: bytes | None = None
    """The secret that callers must prove to know, and that this program proves to servers."""
    tls: Tls | None = None
    lab: Lab | None = None
    """The lab that the user has joined; only for transports that can reach it."""
    accounts: Accounts | str | Path | None = None

    def __repr__(self) -> str:
        # Without the token: it must not appear in logs.
        return f"Settings(domain={self.domain}, listen={self.listen!r}, peers={self.peers})"

    def account_source(self) -> AccountSource | None:
        """Return the accounts that may call; None without accounts. Raises TaskRpcError."""
        if self.accounts is None:
            return None
        from taskrpc.core.security.accounts import AccountSource  # few programs have accounts

        return AccountSource(self.accounts)


def domain_id() -> int:
    """Return `ROS_DOMAIN_ID`, 0 if it is not set. Raises TaskRpcError unless it is 0 to 232."""
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > _MAX_DOMAIN:
        raise TaskRpcError(
            f"ROS_DOMAIN_ID: expected a number from 0 to {_MAX_DOMAIN}, got {text!r}"
        )
    return int(text)


def environment_peers() -> list[str]:
    """Return the peers in `TASKRPC_PEERS`, separated by commas, semicolons or spaces."""
    text = os.environ.get("TASKRPC_PEERS", "")
    return text.replace(",", " ").replace(";", " ").split()

"""The tokens of the live page: of its links, of the server, and of its accounts."""

from __future__ import annotations

import hmac
import secrets
import time

import msgspec

from taskrpc import Role
from taskrpc.spi import AccountSource, account_of


class Holder(msgspec.Struct, frozen=True):
    """The user for whom a request changes something."""

    account: str
    """The account, "" for the server's own user."""
    token: str = ""
    """The account's token, "" for the server's own user."""
    role: Role = Role.ADMIN
    """What the account may do, at the time of the request."""

    @property
    def may_control(self) -> bool:
        """Whether the role of the holder may change anything; `OBSERVE` may not."""
        return self.role > Role.OBSERVE


class Tokens:
    """The tokens that a server accepts, and what each of them allows.

    The tokens of links end with the server. A link may become known to other users of the machine,
    who can see the command line of a browser: so its tokens are not valid for their processes.

    Args:
        server: the server's own token, "" for none; it allows everything.
        accounts: the server's accounts, None for none.
    """

    def __init__(self, server: str = "", accounts: AccountSource | None = None) -> None:
        self.view = secrets.token_urlsafe(32)
        """The token of the link that only shows."""
        self.control = secrets.token_urlsafe(32)
        """The token of the link for control."""
        self._server = server
        self._accounts = accounts

    def may_look(self, given: str, *, of_links: bool = True) -> bool:
        """Return whether a token is valid for the pages; `of_links`: tokens of links count too."""
        is_view = of_links and _is_same(given, self.view)
        return is_view or self.holder(given, of_links=of_links) is not None

    def holder(self, given: str, *, of_links: bool = True) -> Holder | None:
        """Return the user for whom a token allows changes, None if it allows none."""
        if (of_links and _is_same(given, self.control)) or (
            self._server and _is_same(given, self._server)
        ):
            return Holder("")
        if self._accounts is None:
            return None
        self._accounts.refresh()
        name = account_of(given.encode(errors="replace"))
        account = self._accounts.current.find(name, time.time())
        # Compare in every case: the time of the response must not reveal which accounts exist.
        expected = f"{given[::-1]}-" if account is None else account.token
        is_valid = _is_same(given, expected)
        return Holder(name, given, account.role) if is_valid and account else None


def _is_same(given: str, expected: str) -> bool:
    return hmac.compare_digest(given.encode(errors="replace"), expected.encode(errors="replace"))

"""`taskrpc leave`: forget the lab that this user has joined."""

from taskrpc.cli.join import configure_leave as configure

__all__ = ["configure"]

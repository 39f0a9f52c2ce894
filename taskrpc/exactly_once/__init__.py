"""Runs each request of an exactly-once service once, and answers it as often as it comes.

The ledger decides what a request is; a run answers everybody who sent it; the store writes its
effect and its completion in one transaction, before anybody is answered. A lost connection does
not end a run, since its caller will come back: only who cancels, or whose deadline passes, gives
it up, and only before the transaction begins.
"""

from taskrpc.exactly_once.deduplicator import OnceDesk
from taskrpc.exactly_once.runs import Effect, Run

__all__ = ["Effect", "OnceDesk", "Run"]

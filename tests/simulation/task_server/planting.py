"""Plants bugs in the process that simulates, and counts what the product does in a run.

The process keeps this module while it loads the scenario again.
"""

from __future__ import annotations

import importlib
from collections import Counter

from taskrpc.core.attempts import Attempts
from taskrpc.core.exactly_once import Deduplicator, Execution

HAPPENED = Counter()
"""Events of the present run that a caller cannot distinguish from an ordinary response."""
_MISSING = object()
_replaced = []


def plant(place):
    """Plant the bug of a place, such as `module:function`, instead of the one before; "": none."""
    while _replaced:
        owner, name, before = _replaced.pop()
        if before is _MISSING:
            delattr(owner, name)
        else:
            setattr(owner, name, before)
    if place:
        module, _, name = place.partition(":")
        getattr(importlib.import_module(module), name)(_replace)


def _replace(owner, name, replacement, raising=True):
    before = vars(owner).get(name, _MISSING)
    assert not raising or hasattr(owner, name), f"{owner} has no {name}"
    _replaced.append((owner, name, before))
    setattr(owner, name, replacement)


def _count():
    attach, repeat = Execution.attach, Deduplicator._answer_from_store
    wait_after, replace_client = Attempts._wait_after, Attempts._replace_client

    def counted_attach(execution, call):
        HAPPENED["attaches"] += bool(execution.callers)
        attach(execution, call)

    def counted_repeat(deduplicator, call, completion):
        HAPPENED["repeated answers"] += 1
        repeat(deduplicator, call, completion)

    def counted_wait(call, error):
        wait = wait_after(call, error)
        HAPPENED["retries"] += wait is not None
        return wait

    def counted_anew(call):
        is_new = replace_client(call)
        HAPPENED["expired sessions"] += is_new
        return is_new

    Execution.attach, Deduplicator._answer_from_store = counted_attach, counted_repeat
    Attempts._wait_after, Attempts._replace_client = counted_wait, counted_anew


_count()

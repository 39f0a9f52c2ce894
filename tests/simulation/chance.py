"""Takes all randomness and the time of day from one seed; counts internal events."""

from __future__ import annotations

import contextlib
import logging
import os
import random
import time

import pytest

from taskrpc.core import attempts
from taskrpc.core.exactly_once import Deduplicator, Execution, deduplicator
from taskrpc.core.request_ids.ledger import Ledger

LEASE = 20.0
"""Seconds for which a simulated server remembers a client: longer than any call lasts."""


@contextlib.contextmanager
def only_chance(seed, wall_clock, counts):
    """Within the block the product depends on nothing but the seed."""
    drawn = random.Random(seed)
    before = random.getstate()
    random.seed(seed)
    logging.disable(logging.CRITICAL)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "urandom", drawn.randbytes)
        patch.setattr(time, "time", wall_clock)
        patch.setitem(Ledger.__init__.__kwdefaults__, "lease", LEASE)
        patch.setattr(deduplicator, "_EXPIRE_EVERY", 1.0)
        _count(patch, counts)
        try:
            yield drawn
        finally:
            logging.disable(logging.NOTSET)
            random.setstate(before)


def _count(patch, counts):
    """Count events that a caller cannot distinguish from an ordinary response."""
    attach, repeat = Execution.attach, Deduplicator._answer_from_store
    wait_after = attempts.Attempts._wait_after
    replace_client = attempts.Attempts._replace_client

    def counted_attach(execution, call):
        counts["attaches"] += bool(execution.callers)
        attach(execution, call)

    def counted_repeat(deduplicator, call, completion):
        counts["repeated answers"] += 1
        repeat(deduplicator, call, completion)

    def counted_wait(call, error):
        wait = wait_after(call, error)
        counts["retries"] += wait is not None
        return wait

    def counted_anew(call):
        anew = replace_client(call)
        counts["expired sessions"] += anew
        return anew

    patch.setattr(Execution, "attach", counted_attach)
    patch.setattr(Deduplicator, "_answer_from_store", counted_repeat)
    patch.setattr(attempts.Attempts, "_wait_after", counted_wait)
    patch.setattr(attempts.Attempts, "_replace_client", counted_anew)

"""Planted bugs that more than one harness must catch."""

from __future__ import annotations

import asyncio

from taskrpc.core.request_ids.ledger import Ledger, Verdict
from taskrpc.core.transport.pubsub import subscribing
from taskrpc.robot.tasks.worker import Worker


def forget_what_was_done(patch):
    decide = Ledger.decide

    def forgetful(*arguments):
        verdict = decide(*arguments)
        return Verdict.NEW if verdict in (Verdict.DONE, Verdict.ATTACH) else verdict

    patch(Ledger, "decide", forgetful)


def let_a_lost_subscription_go(patch):
    use = subscribing.SubscriptionLink._use

    async def once(self, connection):
        await use(self, connection)
        await asyncio.Event().wait()

    patch(subscribing.SubscriptionLink, "_use", once)


def begin_while_paused(patch):
    async def pause(worker):
        return ""

    patch(Worker, "pause", pause)

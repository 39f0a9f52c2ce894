"""The messages that simulated servers publish, and the subscribers that check them."""

from __future__ import annotations

import asyncio

import srvgen
from taskrpc import QoS, Role

String = srvgen.load("std_msgs/msg/String")
PERIOD = 0.3
"""Seconds between two messages, or a few at once."""
KEPT = QoS(4, durability="transient_local")
HEARD_BY = 10.0
"""Seconds after the last fault within which every subscriber has a current message."""
ROLES = {"news": Role.OBSERVE, "inner": Role.OPERATE}
"""Of the topics."""


class Announcer:
    """Publishes numbered messages as long as its node lives."""

    def __init__(self, node, ledger, chance):
        ledger.lives += 1
        self._life = ledger.lives
        self._ledger = ledger
        self._chance = chance
        self._publishers = [
            node.create_publisher(String, topic, KEPT, role=role) for topic, role in ROLES.items()
        ]
        node.create_timer(PERIOD, self._tell)

    def _tell(self):
        for _ in range(self._chance.choice((1, 1, 1, 7))):
            for each in self._publishers:
                each.publish(String(data=f"{self._life} {each.sent} {self._ledger.now()}"))


class Listener:
    """Subscribes for an account and reports violations to the ledger."""

    def __init__(self, node, name, ledger, account, accounts):
        self._name = name
        self._ledger = ledger
        self._account = account
        self._accounts = accounts
        self._seen = {}
        self._missing = dict.fromkeys(ROLES, 0)
        self._latest = 0.0
        depth = QoS(100, durability="transient_local")
        self._subscriptions = {
            topic: node.create_subscription(
                String, topic, lambda message, topic=topic: self._hear(topic, message), depth
            )
            for topic in ROLES
        }

    def _hear(self, topic, message):
        life, number, told = message.data.split()
        source, number, told = (topic, life), int(number), float(told)
        last = self._seen.get(source, number - 1)
        if number <= last:
            what = f"{self._name} heard {number} of {topic} {life} after {last}"
            self._ledger.broke("heard twice", what)
        if not self._accounts.might(self._account, ROLES[topic], told):
            self._ledger.broke("heard without the right", f"{self._name}: {message.data}")
        self._missing[topic] += max(0, number - last - 1)
        self._seen[source] = max(last, number)
        self._latest = max(self._latest, told)
        self._ledger.counts[f"heard of {topic}"] += 1

    async def hear_of_the_present(self):
        """After the last fault: a message that is published after now must arrive soon."""
        now = self._ledger.now()
        while self._latest < now:
            await asyncio.sleep(PERIOD)
            if self._ledger.now() > now + HEARD_BY:
                self._ledger.broke("heard nothing", self._name)
                break
        for topic, subscription in self._subscriptions.items():
            lost = subscription.lost + subscription.dropped
            self._ledger.counts["lost messages"] += lost
            if self._missing[topic] > lost:
                what = f"{self._name} lacks {self._missing[topic]} of {topic}, knows of {lost}"
                self._ledger.broke("lost unseen", what)
        self._ledger.note(f"{self._name} heard until {self._latest:.6f}, lacks {self._missing}")

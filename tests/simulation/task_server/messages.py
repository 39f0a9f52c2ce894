"""The messages that the servers publish, and the subscribers that check their order."""

import asyncio

from moments import RECOVERED
from records import now, record

import srvgen
from taskrpc import QoS, Role

String = srvgen.load("std_msgs/msg/String")
PERIOD = 0.4
"""Seconds between two messages, or a few at once."""
KEPT = QoS(4, durability="transient_local")
HEARD_BY = 10.0
"""Every subscriber must have a current message of each server so many seconds after the last
fault."""
ROLES = {"news": Role.OBSERVE, "inner": Role.OPERATE}
"""The role that each topic requires."""


class Announcer:
    """Publishes numbered messages as long as its node lives."""

    def __init__(self, node, name, chance):
        self._source = f"{name} {now()}"
        self._chance = chance
        self._publishers = [
            node.create_publisher(String, topic, KEPT, role=role) for topic, role in ROLES.items()
        ]
        node.create_timer(PERIOD, self._publish)

    def _publish(self):
        if now() > RECOVERED + 4.0 and self._chance.random() < 0.6:
            return  # hardly anything happens any more
        for _ in range(self._chance.choice((1, 1, 1, 7))):
            for each in self._publishers:
                each.publish(String(data=f"{self._source} {each.sent} {now()}"))


class Listener:
    """Subscribes, and records what arrived and what is wrong with its order."""

    def __init__(self, node):
        self._seen = {}
        self._missing = dict.fromkeys(ROLES, 0)
        self._latest = {"main": 0.0, "helper": 0.0}
        """When each server published the newest message that arrived."""
        self._heard = []
        """What arrived since the last record."""
        depth = QoS(100, durability="transient_local")
        self._subscriptions = {
            topic: node.create_subscription(
                String, topic, lambda message, topic=topic: self._hear(topic, message), depth
            )
            for topic in ROLES
        }
        node.create_timer(PERIOD, self._record)

    def _hear(self, topic, message):
        server, since, number, sent = message.data.split()
        source, number, sent = (topic, server, since), int(number), float(sent)
        last = self._seen.get(source, number - 1)
        if number <= last:
            record("heard twice", f"{number} of {source} after {last}")
        self._missing[topic] += max(0, number - last - 1)
        self._seen[source] = max(last, number)
        self._latest[server] = max(self._latest[server], sent)
        self._heard.append((topic, server, sent))

    def _record(self):
        if self._heard:
            record("heard", self._heard)
            self._heard = []

    async def hear_the_present(self):
        """Wait for a message of each server that is published after now: it must arrive soon."""
        begin = now()
        while min(self._latest.values()) < begin:
            await asyncio.sleep(PERIOD)
            if now() > begin + HEARD_BY:
                record("heard nothing")
                break
        self._record()
        lost = {topic: each.lost + each.dropped for topic, each in self._subscriptions.items()}
        record("heard in the end", self._missing, lost)

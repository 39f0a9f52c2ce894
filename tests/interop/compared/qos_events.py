"""Events of deadline, liveliness and incompatible QoS."""

import rclpy
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import (
    DeadlineBestAvailable,
    DurabilityPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from shared import Robot, end, milliseconds
from std_msgs.msg import String

MANUAL, AUTOMATIC = LivelinessPolicy.MANUAL_BY_TOPIC, LivelinessPolicy.AUTOMATIC
BEST_EFFORT, LATCHED = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.TRANSIENT_LOCAL
FIELDS = (
    "total_count",
    "total_count_change",
    "last_policy_kind",
    *("alive_count", "alive_count_change", "not_alive_count", "not_alive_count_change"),
)


class Pair:
    """A publisher and a subscription, and their events."""

    def __init__(self, robot, number, offered, requested):
        self.events = []
        self._robot = robot
        topic = f"topic{number}"
        callbacks = {
            name: lambda event, name=name: self._note(f"publisher {name}", event)
            for name in ("deadline", "liveliness", "incompatible_qos")
        }
        self.publisher = robot.node.create_publisher(
            String,
            topic,
            QoSProfile(depth=10, **offered),
            event_callbacks=PublisherEventCallbacks(**callbacks),
        )
        callbacks = {
            name: lambda event, name=name: self._note(f"subscription {name}", event)
            for name in ("deadline", "liveliness", "incompatible_qos")
        }
        self.subscription = robot.node.create_subscription(
            String,
            topic,
            lambda message: None,
            QoSProfile(depth=10, **requested),
            event_callbacks=SubscriptionEventCallbacks(**callbacks),
        )

    def _note(self, what, event):
        values = [int(getattr(event, name)) for name in FIELDS if hasattr(event, name)]
        self.events.append(f"{what} {values}")

    def show(self, what, seconds):
        """Spin, and print the events since the last call."""
        self._robot.spin(seconds)
        print(f"{what}: {sorted(self.events)}", flush=True)
        self.events.clear()

    def destroy(self):
        """Destroy both."""
        self._robot.node.destroy_publisher(self.publisher)
        self._robot.node.destroy_subscription(self.subscription)


def deadlines(robot):
    limit = {"deadline": milliseconds(500)}
    pair = Pair(robot, 0, limit, limit)
    pair.show("before the first message", 0.8)
    pair.publisher.publish(String())
    pair.show("two periods of silence", 1.25)
    pair.publisher.publish(String())
    pair.show("in time", 0.3)
    pair.publisher.publish(String())
    pair.show("in time again", 0.3)
    pair.show("late", 0.4)
    robot.node.destroy_publisher(pair.publisher)
    pair.events.clear()
    pair.show("without a publisher", 0.7)
    pair.destroy()


def liveliness(robot):
    lease = {"liveliness": MANUAL, "liveliness_lease_duration": milliseconds(400)}
    pair = Pair(robot, 1, lease, lease)
    pair.show("not asserted", 1.0)
    pair.publisher.assert_liveliness()
    pair.show("asserted", 0.2)
    pair.show("lost", 1.0)
    pair.publisher.publish(String())
    pair.show("published", 0.2)
    pair.show("lost again", 1.0)
    pair.publisher.assert_liveliness()
    pair.show("asserted again", 0.2)
    robot.node.destroy_publisher(pair.publisher)
    pair.show("destroyed", 0.5)
    pair.destroy()


CASES = {
    "deadline not offered": ({}, {"deadline": milliseconds(100)}),
    "deadline not requested": ({"deadline": milliseconds(100)}, {}),
    "longer deadline requested": ({"deadline": milliseconds(100)}, {"deadline": milliseconds(200)}),
    "shorter deadline requested": (
        {"deadline": milliseconds(200)},
        {"deadline": milliseconds(100)},
    ),
    "best available deadline": ({}, {"deadline": DeadlineBestAvailable}),
    "manual requested": ({"liveliness": AUTOMATIC}, {"liveliness": MANUAL}),
    "manual offered": ({"liveliness": MANUAL}, {"liveliness": AUTOMATIC}),
    "lease not offered": ({}, {"liveliness_lease_duration": milliseconds(100)}),
    "shorter lease requested": (
        {"liveliness_lease_duration": milliseconds(200)},
        {"liveliness_lease_duration": milliseconds(100)},
    ),
    "lease not requested": ({"liveliness_lease_duration": milliseconds(100)}, {}),
    "reliability and deadline": ({"reliability": BEST_EFFORT}, {"deadline": milliseconds(100)}),
    "reliability and durability": ({"reliability": BEST_EFFORT}, {"durability": LATCHED}),
    "liveliness and deadline": ({}, {"liveliness": MANUAL, "deadline": milliseconds(100)}),
    "durability and deadline": ({}, {"durability": LATCHED, "deadline": milliseconds(100)}),
}


def incompatibilities(robot):
    for number, (what, (offered, requested)) in enumerate(CASES.items(), 2):
        pair = Pair(robot, number, offered, requested)
        pair.show(what, 0.4)
        pair.destroy()


rclpy.init()
robot = Robot()
deadlines(robot)
liveliness(robot)
incompatibilities(robot)
end()

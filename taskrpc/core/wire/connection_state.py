"""The life of a connection: one state, and one table of the changes that are allowed.

A session begins with the handshake, is open for calls, may drain, and is closed in the end:

    HANDSHAKE ── HANDSHAKE_DONE ─▶ OPEN ── DRAIN ─▶ DRAINING
        └────────────── END ────────┴────── END ───────┴────▶ CLOSED

Both ends have their own state: DRAIN means that GOAWAY was sent (server) or received (client). Only
`next_state` decides on a change, so that no sequence of frames and calls can reopen a session.
"""

from __future__ import annotations

from enum import Enum


class ConnectionState(Enum):
    """Where a connection stands."""

    HANDSHAKE = "handshake"
    """Neither end has proved itself to the other."""
    OPEN = "open"
    """Calls may begin."""
    DRAINING = "draining"
    """No call may begin; those in flight are still answered."""
    CLOSED = "closed"
    """Nothing more is read or sent."""


class StateEvent(Enum):
    """What changes the state of a connection."""

    HANDSHAKE_DONE = "handshake done"
    DRAIN = "drain"
    """GOAWAY was sent or received; a repeated one changes nothing."""
    END = "end"
    """Closed by this end, refused, lost, or broken by the peer; a repeated one changes nothing."""


TRANSITIONS = {
    (ConnectionState.HANDSHAKE, StateEvent.HANDSHAKE_DONE): ConnectionState.OPEN,
    (ConnectionState.OPEN, StateEvent.DRAIN): ConnectionState.DRAINING,
    (ConnectionState.DRAINING, StateEvent.DRAIN): ConnectionState.DRAINING,
    (ConnectionState.HANDSHAKE, StateEvent.END): ConnectionState.CLOSED,
    (ConnectionState.OPEN, StateEvent.END): ConnectionState.CLOSED,
    (ConnectionState.DRAINING, StateEvent.END): ConnectionState.CLOSED,
    (ConnectionState.CLOSED, StateEvent.END): ConnectionState.CLOSED,
}
"""Every allowed change; any other combination is a mistake in this program, not of the peer."""


def next_state(state: ConnectionState, event: StateEvent) -> ConnectionState:
    """The state after an event. Raises AssertionError for an event that is not in the table."""
    following = TRANSITIONS.get((state, event))
    if following is None:
        raise AssertionError(f"a connection in state {state.value!r} got the event {event.value!r}")
    return following

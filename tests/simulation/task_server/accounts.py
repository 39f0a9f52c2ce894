"""The accounts of each server over time, and what they may do."""

RANKS = ("observe", "submit", "operate")
GRACE = 1.7
"""Seconds until a server notices that an account changed: it looks once a second,
and lets the caller read the reason."""
TOPICS = {"news": "observe", "inner": "operate"}


class Accounts:
    """The past of all accounts."""

    def __init__(self):
        self._past = {}

    def changed(self, server, now, user, role, revoked):
        self._past.setdefault((server, user), []).append((now, role, revoked))

    def may_use(self, server, user, kind, now):
        """Whether a server may still believe that an account may call a service."""
        return self._might(server, user, "operate" if kind == "steer" else "submit", now)

    def may_hear(self, server, user, topic, sent):
        """Whether a server might send a message to an account since it was published."""
        return self._might(server, user, TOPICS[topic], sent)

    def _might(self, server, user, least, now):
        for began, role, revoked in reversed(self._past[server, user]):
            if not revoked and RANKS.index(role) >= RANKS.index(least):
                return True
            if began < now - GRACE:
                return False
        return False

"""When things happen, in virtual seconds since the begin of a run."""

CALM = 8.0
"""After this, no fault happens any more."""
RECOVERED = CALM + 5.0
"""From now on every call must be answered: servers that were killed have started again."""
END = 24.0
"""The servers shut down; all callers have ended before."""
DURATION = END + 6.0
LEASE = 10.0
"""A server remembers a client so long: longer than any call lasts."""

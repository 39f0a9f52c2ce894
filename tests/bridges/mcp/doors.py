"""A policy for tests: a table of decisions."""

from taskrpc.bridges.door import Decision, Outcome


class TableDoor:
    """Decides by target; everything else is refused. It keeps what it was asked."""

    def __init__(self, **decisions):
        self._decisions = {f"/{name.replace('__', '/')}": each for name, each in decisions.items()}
        self.asked = []

    def permits(self, name, verb, target):
        return target in self._decisions

    def decide(self, name, verb, target, message=None):
        self.asked.append((name, verb, target, message))
        refused = Decision(Outcome.REFUSED, 1, f"no rule lets {name} {verb} {target}")
        return self._decisions.get(target, refused)

"""The policy of a door: which names may call, read and publish what, and within which limits.

Start with `policy`, the rules as values. `decisions` decides one request, `policy_file` reads the
rules from YAML, and `explanation` says them in plain words; these modules are pure. `door` is the
thin shell: it reads the file again when it changes, and has the clock. A bridge asks
`Door.decide` before it passes a request on. What a bridge then does does not belong here.
"""

from taskrpc.bridges.door.decisions import Decision, Outcome
from taskrpc.bridges.door.door import Door
from taskrpc.bridges.door.policy import Policy
from taskrpc.bridges.door.policy_file import PolicyError, parse_policy

__all__ = ["Decision", "Door", "Outcome", "Policy", "PolicyError", "parse_policy"]

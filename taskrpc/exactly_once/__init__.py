"""The upper half of exactly-once: executes each request once, and answers each repetition of it.

Start with `deduplicator`: it asks the ledger about each request and then executes it, attaches it
to its execution, or answers it from the store. `executions` holds one running request and its
callers, `store_state` what the services of a store share, `stores` and `completions` what is
stored. Request ids and the ledger, which the transport also needs, are the lower half:
`taskrpc.request_ids`.
"""

from taskrpc.exactly_once.deduplicator import Deduplicator
from taskrpc.exactly_once.executions import Effect, Execution

__all__ = ["Deduplicator", "Effect", "Execution"]

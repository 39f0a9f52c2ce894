"""The upper half of exactly-once: executes each request once, and answers each repetition of it.

Start with `deduplicator`: it looks up each request in the ledger, and then executes it, attaches it
to its execution, or answers it from the store. `executions` contains one running request and its
callers, `store_state` the state that the services of a store share, `stores` and `completions` the
stored data. Request ids and the ledger, which the transport also needs, are the lower half:
`taskrpc.core.request_ids`.
"""

from taskrpc.core.exactly_once.deduplicator import Deduplicator
from taskrpc.core.exactly_once.executions import Effect, Execution

__all__ = ["Deduplicator", "Effect", "Execution"]

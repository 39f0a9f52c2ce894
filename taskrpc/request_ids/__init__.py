"""The lower half of exactly-once: request ids, and the ledger of the requests that a store knows.

Start with `ids`. Both modules are pure: the transport sends ids, the server asks the ledger. What
executes each request once and stores its completion is the upper half, `taskrpc.exactly_once`."""

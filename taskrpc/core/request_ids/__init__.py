"""The lower half of exactly-once: request ids, and the ledger of the requests that a store knows.

Start with `ids`. Both modules are pure: the transport sends ids, and the server looks up requests
in the ledger. The upper half, `taskrpc.core.exactly_once`, executes each request once and stores
its completion."""

"""The lower floor of exactly-once: the ids of requests, and the ledger of what is known of them.

Start with `ids`. Both are pure: the transport sends ids, the server asks the ledger. The upper
floor, which runs each request once and stores its completion, is `taskrpc.exactly_once`."""

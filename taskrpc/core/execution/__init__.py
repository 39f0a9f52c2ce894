"""How handlers and callbacks run: coroutines started eagerly, threads, and the fair queue.

Start with `eager_start`, which runs a coroutine and makes a task only if it suspends. `callbacks`
runs the callbacks of subscriptions and timers, `daemon_threads` those that may block. `fair_queue`
decides which caller is next. Nothing here knows requests, responses or services.
"""

"""How handlers run: steps of coroutines, callbacks of subscriptions and timers, turns of callers.

Start with `stepping`, which runs a handler and makes a task of it only if it suspends. `fair_queue`
decides which caller is next. What a call is, and how it is answered, is not known here."""

"""The order of the tasks and the estimate for each of them.

Start reading with `task_queue`; `estimated_queue` adds the estimates, and `schedule` the plans that
both need. Nothing here does I/O or reads a clock."""

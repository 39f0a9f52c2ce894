"""The order of the tasks, and when each of them will be done.

Start with `task_queue`; `timetable` keeps the estimates of all waiting tasks. Nothing here does
I/O or reads a clock."""

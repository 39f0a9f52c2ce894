"""What the task server remembers: it stores every change before it announces it.

Start reading with `repository`, which makes all changes. `store` is the interface to the disk and
`sqlite_store` the file; `change_feed` wakes watchers. `history` says which ended tasks are kept,
and `archive` reads all of them. Nothing here decides about tasks."""

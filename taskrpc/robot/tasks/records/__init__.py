"""What the task server remembers: it stores every change before it announces it.

Start reading with `repository`, which makes all changes. `store` is the interface to the disk and
`sqlite_store` the file; `change_feed` wakes watchers. Nothing here decides about tasks."""

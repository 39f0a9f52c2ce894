"""What the task server remembers: every change is stored before it is announced.

Start with `repository`, which all changes go through; `store` is the seam to the disk and
`sqlite_store` the file. `change_feed` wakes those who watch."""

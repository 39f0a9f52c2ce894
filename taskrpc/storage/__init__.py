"""Files in which something survives: one SQLite file a store, held by one process."""

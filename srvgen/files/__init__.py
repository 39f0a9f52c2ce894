"""Definition files: read them, find them by type name, collect dependencies, check and repair.

Start with `search`, which finds and loads a type, and `dependencies`, which loads all that it
needs. `warnings` and `fix` are behind `srvgen check` and `srvgen fix`. The grammar is not here:
see `srvgen.parser` for whole texts and `srvgen.definitions` for the parts."""

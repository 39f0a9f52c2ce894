"""Explains what would wait for ever or fail in silence. Start with `explain`."""

"""The TCP transport's protocol as pure state machines: bytes in, bytes and events out."""

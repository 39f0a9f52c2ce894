"""The module from which programs import the types of message fields; it parses nothing."""

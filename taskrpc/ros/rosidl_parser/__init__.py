"""What programs import to look at the types of a message's fields; nothing is parsed here."""

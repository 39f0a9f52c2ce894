"""Which callback runs when, and on which thread. Start with `rounds`."""

"""Classes of interfaces by their names."""

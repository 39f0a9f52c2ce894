"""Parameters of nodes: declared, checked, set and listed. Start with `node_parameters`."""

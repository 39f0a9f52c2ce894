"""From the text of a definition to its model: lines, names, types, literals, and where files are.

Start with `parser`, which reads a text, and `model`, which holds what was read. `search` finds
the file of a type, `dependencies` all that a type needs. `diagnostics` explains mistakes."""

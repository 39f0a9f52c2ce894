"""What is wrong with a definition, what its author most likely meant, and how to repair it.

Start with `diagnosis`, which the parser calls once a line is refused; `fix` repairs files.
Nothing here reads a correct definition."""

"""Why a line of a definition is invalid, what its author most likely meant, and the repair.

Start with `line_errors`, which the parser calls for a line that it has refused; `line_hints` and
`type_hints` recognise the usual mistakes. A valid line never comes here, so that reading it costs
nothing more; problems of whole files (missing types, warnings, repairs) are in `files`."""

"""The model of interface definitions and the rules of the definition language.

Start with `model`, the values that the parser produces; `names`, `field_types`, `literals` and
`lines` read one part of a definition each, `derived` adds the types that a service or an action
implies, `limits` says how large definitions may be. Nothing here reads files, explains errors or
knows Python classes."""

"""MCP: the services, actions and topics of the network as tools and resources of an agent.

Start with `calls`, which carries out one call of a tool. `tools` finds the services and actions,
and `topics` reads the resources. `tool_names`, `schemas`, `arguments`, `results` and `permissions`
are pure: names, JSON Schemas, requests from JSON, what an agent is told, and what it may do.
`server` connects them to the protocol, and `serving` to standard input and HTTP; only these two
modules import the package `mcp` (the extra `mcp`). Rules about who may do what do not belong here.
"""

"""How taskrpc's costs grow with connections, services, queued tasks and payloads."""

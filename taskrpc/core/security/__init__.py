"""Access control: roles, accounts, certificates, and the rule for the addresses of a server.

Start with `roles`; `accounts` reads a file of accounts again when it changes. The handshake is in
`wire.handshake`. Nothing here opens a connection.
"""

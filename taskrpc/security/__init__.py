"""Who may connect, and who may do what: roles, accounts, certificates, and the rule for listening.

Start with `roles`; `accounts` follows a file of accounts while it changes. The handshake itself is
in `wire.handshake`, and nothing here opens a connection.
"""

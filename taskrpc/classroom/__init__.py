"""A class whose laptops call one robot: certificates, accounts and join strings.

Start with `register`, which holds the accounts of a class; `invitation` makes the join strings
and `joining` uses them on a laptop. The commands are in `taskrpc.cli.classroom` and
`taskrpc.cli.join`; what every program needs after joining is in `taskrpc.security.lab`.
"""

"""The fleet's database in PostgreSQL.

Start reading with `store`, a server's access to it. `schema` creates and upgrades the tables,
`connection` makes connections and explains their errors. `archive` reads all ended tasks while the
servers run. Import this package only with `--db postgresql://…`: it needs psycopg.
"""

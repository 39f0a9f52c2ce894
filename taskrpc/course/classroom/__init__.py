"""A class whose laptops call one robot: certificates, accounts and join strings.

Start with `register`, which stores the accounts of a class; `student_names` derives them from the
students' names, and `class_server` stores where the laptops reach the server. `invitation` makes
the join strings, `joining` uses them on a laptop. The commands are in
`taskrpc.cli.course.classroom` and `taskrpc.cli.course.join`; the code that every program needs
after joining is in `taskrpc.core.security.lab`.
"""

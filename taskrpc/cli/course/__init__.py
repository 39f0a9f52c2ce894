"""Verbs of the course: for the lecturer and for the students.

`classroom` and `scene` are for the lecturer, `join` and `lab` for the students. Start with `join`,
which is short. Labs, scenes and classes themselves are in `taskrpc.course`.
"""

"""Messages as CDR, the encoding of ROS 2: one encoder and one decoder compiled for each class.

Start with `messages`, which has `to_cdr` and `from_cdr`; `plan` says in which order values stand,
`encode` and `decode` compile it. Nothing here does I/O."""

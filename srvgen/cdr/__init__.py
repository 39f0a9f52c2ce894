"""CDR, the encoding of ROS 2: one encoder and one decoder are compiled for each message class.

Start with `messages`, which has `to_cdr` and `from_cdr`; `plan` puts the values of a class in
order, `encode` and `decode` turn the plan into Python functions. Nothing here does I/O or reads
definitions."""

"""The command lines `taskrpc`, `taskrpc-call` and `taskrpc-server`.

Each verb of `taskrpc` has a module or a folder of its name, in one of six groups. If `ros2` has the
verb too, it is in `ros`. The other groups are `robot` (the task server, its tasks and the demo),
`observe` (what people see of running programs), `course` (classes, labs and scenes), `network`
(the processes of this machine, and doors to other networks) and `workspace` (programs and packages
on the disk, your shell and your Python). A grouping by the district that does the work would spread
the verbs of `ros2` over three groups, and a newcomer knows the verb before the code behind it.

Start with `main`, which chooses the verb. `call` is `taskrpc-call`, and `robot.server` is
`taskrpc-server`. `shared` contains the helpers of several verbs. In the folder of a verb, start
with `command_line`. The library never imports from here. Code that a program can use without a
command line belongs to the library.
"""

"""What `taskrpc top` and the notebook show: the programs, their rates, the queue and the robot.

Start with `reading`, which asks the programs and the task servers; `model` computes rates from
their counts and is pure. Pictures are not here: the terminal's is in `taskrpc.cli.observe.top`.
"""

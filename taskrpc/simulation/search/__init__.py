"""The search for a run that fails, in worker processes, and its explanation.

`search` is what the command calls; `worker` runs in each process; `shrink` finds the fewest
faults, `story` tells the run, and `recording` writes it with the calls of `told_calls`. What a run
is belongs to `taskrpc.simulation.run`.
"""

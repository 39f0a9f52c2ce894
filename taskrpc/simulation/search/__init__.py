"""The search for a run that fails, in worker processes, and its explanation.

`search` is what the command calls; `worker` runs in each process; `shrink` finds the fewest
faults, and `story` tells the run. What a run is belongs to `taskrpc.simulation.run`.
"""

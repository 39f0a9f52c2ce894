"""The six labs of the course: starter files, variants, and the checks of a submission.

Start with `lab`, the model, and `checks/lab1`, the shortest example. `catalogue` lists all labs.
A check talks to a submission through a `trial`, so the same checks run against a child process
and in a browser tab. Solutions and hidden checks are not here: they are in `examples/labs`.
"""

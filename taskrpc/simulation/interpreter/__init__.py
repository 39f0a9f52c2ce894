"""One interpreter in which many programs run, one stack at a time, in virtual time.

`interpreter` prepares the process. `stacks` decides who runs and moves the clock; `threads`,
`loop` and `clocks` take the place of Python's own; `programs` loads a program and ends it as a
process; `state` gives each program its own module variables. `refusals` and `watchdog` stop what
cannot be simulated.
"""

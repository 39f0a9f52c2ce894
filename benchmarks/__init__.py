"""What the project measures of itself and of others; `python benchmarks/run.py` runs the calls."""

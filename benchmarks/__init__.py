"""The project's benchmarks of itself and others; `python benchmarks/run.py` measures calls."""

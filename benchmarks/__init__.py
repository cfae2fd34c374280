"""Measurements: speed beside accuracy, against what others would use. `python -m benchmarks` runs them all."""

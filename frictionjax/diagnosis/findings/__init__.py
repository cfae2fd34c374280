"""Findings: what is reported of every effect, of what is left, and of the next experiment."""

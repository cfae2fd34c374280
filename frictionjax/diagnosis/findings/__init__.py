"""Findings: what is reported of every effect, of what remains, and of the next experiment."""

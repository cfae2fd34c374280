"""Intake: what a case must have to be diagnosed, what it cannot show, and starting values."""

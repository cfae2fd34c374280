"""Intake: what a case must contain, which effects it cannot show, and starting values."""

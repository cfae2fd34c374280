"""Descent: an objective brought to its minimum, from any start and from near by."""

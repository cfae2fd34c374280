"""Descent: the ways down an objective."""

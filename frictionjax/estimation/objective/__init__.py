"""Objective: what a fit brings down, its slope and curvature."""

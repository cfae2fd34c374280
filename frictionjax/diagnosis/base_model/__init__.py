"""Base model: LuGre and inertia fitted, and whether that fit is credible."""

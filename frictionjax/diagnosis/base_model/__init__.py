"""Base model: LuGre and inertia fitted, and whether the fit is credible."""

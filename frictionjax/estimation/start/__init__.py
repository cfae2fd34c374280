"""Start: starting values read off the recordings."""

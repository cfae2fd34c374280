"""Refitting: the candidates that screening leaves, with everything free."""

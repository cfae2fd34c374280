"""Mismatch map: where the base model fails, before any effect is named."""

"""Mismatch map: where the base model fails, before anything is named."""

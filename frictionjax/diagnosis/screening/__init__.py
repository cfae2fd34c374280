"""Screening: every effect of the catalogue tested without a refit."""

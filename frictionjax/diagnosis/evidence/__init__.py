"""Evidence: what a fitted model explains of all recordings, above the noise floor."""

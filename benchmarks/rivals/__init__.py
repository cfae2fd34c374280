"""What others would use for the same work. Each says in a sentence when what it needs is not installed."""

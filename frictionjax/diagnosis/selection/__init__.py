"""Selection: which effects are named, and how sure that is."""

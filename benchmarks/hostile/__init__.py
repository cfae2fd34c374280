"""Damaged and hostile inputs of every reader: each ends in a recording, or in one line that says what is wrong."""

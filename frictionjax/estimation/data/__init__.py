"""Data: recordings side by side in arrays, with noise levels and starting states."""

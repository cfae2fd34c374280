"""Hensen, van de Molengraft, Steinbuch (2002) reproduced: numbers in `experiments`, figures and tables in `figures`."""

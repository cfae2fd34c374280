"""The blind challenge: `python -m benchmarks.concealed make|solve|reveal`.

`reality/` makes machines and recordings and imports nothing of the library; `make` seals what they conceal, `solve`
diagnoses them without the truth, `reveal` checks the seal and scores.
"""

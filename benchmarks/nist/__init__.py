"""The nonlinear regression problems of NIST's Statistical Reference Datasets, by the least squares of `fit` and by
scipy."""

"""Pictures of results: what `.plot()` draws."""

from frictionjax.report.plots.plot import plot as plot

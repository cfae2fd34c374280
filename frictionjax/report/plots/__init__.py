"""Pictures of results: what `.plot()` draws."""

from typing import TYPE_CHECKING

from frictionjax.core.late_door import late_door

if TYPE_CHECKING:
    from frictionjax.report.plots.plot import plot as plot

# It knows every kind of result; a picture of recordings needs none of them.
late_door(__name__, {"plot": "plot"})

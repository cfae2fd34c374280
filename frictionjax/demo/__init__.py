"""The embedded case of `frictionjax demo`: a machine that stands in for reality.

Nothing here knows the models, the integrator or the estimators of the package, and none of them knows this:
its friction is of another form, and its motion is computed by other means.
"""

from frictionjax.demo.write import write_demo_case as write_demo_case

"""The case of `frictionjax demo`: a simulated machine in place of a real one.

It shares no code with the models, the integrator or the estimators of the package: its friction has another form, and
its motion is computed by another scheme.
"""

from frictionjax.demo.write import write_demo_case as write_demo_case

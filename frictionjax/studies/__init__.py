"""Monte Carlo and sweeps: a function over a design, the level sweep, and the comparison of estimators."""

from frictionjax.studies.estimator_comparison import EstimatorComparison as EstimatorComparison
from frictionjax.studies.estimator_comparison import compare_estimators as compare_estimators
from frictionjax.studies.level_sweep import LevelSweep as LevelSweep
from frictionjax.studies.level_sweep import level_sweep as level_sweep
from frictionjax.studies.run import Design as Design
from frictionjax.studies.run import Study as Study
from frictionjax.studies.run import grid as grid
from frictionjax.studies.run import run_study as run_study

"""Monte Carlo studies and sweeps: designs, tasks, running and resuming them, summaries; the level sweep, and the
comparison of estimators."""

from frictionjax.studies.axes import Axis as Axis
from frictionjax.studies.calibration import Calibration as Calibration
from frictionjax.studies.calibration import calibration_of as calibration_of
from frictionjax.studies.calibration import calibration_study as calibration_study
from frictionjax.studies.check import check_diagnosis as check_diagnosis
from frictionjax.studies.design import AbstractDesign as AbstractDesign
from frictionjax.studies.design import Factorial as Factorial
from frictionjax.studies.design import RandomDesign as RandomDesign
from frictionjax.studies.design import SobolDesign as SobolDesign
from frictionjax.studies.discrimination_task import DiscriminationTask as DiscriminationTask
from frictionjax.studies.estimator_comparison import EstimatorComparison as EstimatorComparison
from frictionjax.studies.estimator_comparison import compare_estimators as compare_estimators
from frictionjax.studies.experiment import Experiment as Experiment
from frictionjax.studies.fit_tasks import DiagnosisTask as DiagnosisTask
from frictionjax.studies.fit_tasks import FitTask as FitTask
from frictionjax.studies.level_sweep import LevelSweep as LevelSweep
from frictionjax.studies.level_sweep import level_sweep as level_sweep
from frictionjax.studies.machine_tasks import ResponseTask as ResponseTask
from frictionjax.studies.machine_tasks import SimulationTask as SimulationTask
from frictionjax.studies.run import StudyStopped as StudyStopped
from frictionjax.studies.run import run_study as run_study
from frictionjax.studies.store import load_study as load_study
from frictionjax.studies.study import Study as Study
from frictionjax.studies.summary import summarise as summarise
from frictionjax.studies.task import AbstractTask as AbstractTask
from frictionjax.studies.task import CompiledTask as CompiledTask
from frictionjax.studies.task import PythonTask as PythonTask

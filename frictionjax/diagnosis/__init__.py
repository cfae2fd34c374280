"""From recordings to a verdict: locate the mismatch, name it, model it, verify it on held-out recordings."""

from frictionjax.diagnosis.diagnose import diagnose as diagnose
from frictionjax.diagnosis.effort import Effort as Effort
from frictionjax.diagnosis.rule import Rule as Rule
from frictionjax.diagnosis.verdict import Diagnosis as Diagnosis
from frictionjax.diagnosis.warm import Warmed as Warmed
from frictionjax.diagnosis.warm import warm as warm

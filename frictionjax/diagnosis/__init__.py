"""From recordings to a verdict: locate the mismatch, name it, model it, judge it on recordings kept aside."""

from frictionjax.diagnosis.diagnose import diagnose as diagnose
from frictionjax.diagnosis.verdict import Diagnosis as Diagnosis

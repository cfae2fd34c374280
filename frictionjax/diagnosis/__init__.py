"""From recordings to a verdict: locate the mismatch, name it, model it, verify it on held-out recordings."""

from frictionjax.diagnosis.diagnose import diagnose as diagnose
from frictionjax.diagnosis.verdict import Diagnosis as Diagnosis

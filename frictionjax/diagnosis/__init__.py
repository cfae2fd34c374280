"""From recordings to a verdict: locate the mismatch, name it, model it, verify it on held-out recordings."""

from typing import TYPE_CHECKING

from frictionjax.core.late_door import late_door

if TYPE_CHECKING:
    from frictionjax.diagnosis.diagnose import diagnose as diagnose
    from frictionjax.diagnosis.effort import Effort as Effort
    from frictionjax.diagnosis.rule import Rule as Rule
    from frictionjax.diagnosis.verdict import Diagnosis as Diagnosis
    from frictionjax.diagnosis.warm import Warmed as Warmed
    from frictionjax.diagnosis.warm import warm as warm

late_door(
    __name__,
    {
        "diagnose": "diagnose",
        "Effort": "effort",
        "Rule": "rule",
        "Diagnosis": "verdict",
        "Warmed": "warm",
        "warm": "warm",
    },
)

"""What `diagnose_arm` found: a diagnosis of each joint, and one table of all."""

import math
from pathlib import Path
from typing import Any, Literal

import equinox as eqx

from frictionjax.arm.fit_rigid_body import RigidBodyFit
from frictionjax.core import Estimate
from frictionjax.core.display import AbstractDisplayed, Display, TextGrid
from frictionjax.core.frames import records, to_dataframe
from frictionjax.core.front_door import public_verb
from frictionjax.diagnosis import Diagnosis


class JointDiagnosis(eqx.Module):
    """The friction of one joint.

    **Attributes:** `joint` (its name), `diagnosis` (what was found; None where it was not diagnosed), `reason` (why it
    was not, as a sentence; empty where it was).
    """

    joint: str = eqx.field(static=True)
    diagnosis: Diagnosis | None
    reason: str = eqx.field(static=True, default="")


class ArmDiagnosis(AbstractDisplayed):
    """What `diagnose_arm` found.

    **Attributes:**

    - `name`: of the arm's first log.
    - `rigid_body`: the refitted rigid-body dynamics, a `RigidBodyFit`.
    - `joints`: a `JointDiagnosis` for each joint, in the order of the log.
    - `warnings`: sentences on the arm as a whole.
    - `seconds`: how long it took.
    """

    name: str = eqx.field(static=True)
    rigid_body: RigidBodyFit
    joints: tuple[JointDiagnosis, ...]
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    seconds: float = eqx.field(static=True, default=0.0)

    def __getitem__(self, joint: str) -> Diagnosis:
        """The diagnosis of the joint called `joint`; `KeyError` for one that was not diagnosed."""
        found = next((one.diagnosis for one in self.joints if one.joint == joint), None)
        if found is None:
            raise KeyError(joint)
        return found

    def table(self) -> list[dict[str, Any]]:
        """A row for each joint: torque, what the rigid bodies leave of it, the verdict, what is named with its
        parameters, and the error of the force on held-out logs without and with it, force units."""
        return [
            {**rigid, **_row(one)} for rigid, one in zip(self.rigid_body.table(), self.joints, strict=True)
        ]

    @property
    def summary(self) -> str:
        """One sentence: which joints lack what."""
        named = [
            f"{one.joint} ({', '.join(missing.effect for missing in one.diagnosis.missing)})"
            for one in self.joints
            if one.diagnosis is not None and one.diagnosis.missing
        ]
        others = {
            "Base model adequate": [one.joint for one in self.joints if _verdict(one) == "adequate"],
            "Not explained by the catalogue": [
                one.joint
                for one in self.joints
                if _verdict(one) == "unknown" and one.diagnosis.missing == ()  # type: ignore[union-attr]
            ],
            "Not diagnosed": [one.joint for one in self.joints if one.diagnosis is None],
        }
        parts = [f"Named in {len(named)} of {len(self.joints)} joints: {', '.join(named)}." if named else ""]
        parts += [f"{words}: {', '.join(joints)}." for words, joints in others.items() if joints]
        return " ".join(part for part in parts if part)

    def save(self, directory: str | Path) -> Path:
        """Write index.html, arm.json and a folder for each joint into `directory`; returns it:
        `frictionjax.save_arm_diagnosis`."""
        return public_verb("save_arm_diagnosis")(self, directory)

    def plot(self, **how: Any) -> Any:
        """Draw for each joint the torque, what the rigid bodies leave of it, and the held-out errors of its friction:
        `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self, what: Literal["joints", "parameters"] = "joints") -> Any:
        """A pandas DataFrame.

        **Arguments:**

        - `what`: `"joints"` (the `table`), or `"parameters"` (the refitted base parameters).

        **Raises:** `ImportError` where pandas is missing.
        """
        if what == "parameters":
            return self.rigid_body.to_dataframe("parameters")
        return to_dataframe(records(self.table()), index="joint")

    def _display(self) -> Display:
        head = ("joint", "verdict", "named", "confidence", "held-out error, base", "extended", "unit")
        rows = tuple(
            (
                row["joint"],
                row["verdict"],
                row["effects"],
                _short(row["confidence"], 2),
                _short(row["error_base"]),
                _short(row["error_extended"]),
                row["unit"],
            )
            for row in self.table()
        )
        return Display(
            f"Diagnosis of the arm {self.name}", (self.summary, *self.warnings), (TextGrid(head, rows),)
        )


def _verdict(one: JointDiagnosis) -> str:
    if one.diagnosis is None or not one.diagnosis.was_diagnosed:
        return "not diagnosed"
    return one.diagnosis.verdict


def _row(one: JointDiagnosis) -> dict[str, Any]:
    found = one.diagnosis
    missing = () if found is None else found.missing
    floors = [] if found is None else [fit.noise_floor for fit in found.recordings if fit.role == "holdout"]
    before, after = found.held_out_rmse() if found is not None and floors else (math.nan, math.nan)
    return {
        "verdict": _verdict(one),
        "effects": ", ".join(effect.effect for effect in missing),
        "confidence": missing[0].confidence if missing else math.nan,
        "parameters": "; ".join(
            _text(name, value) for effect in missing for name, value in effect.parameters.items()
        ),
        "error_base": before,
        "error_extended": after,
        "noise_floor": math.sqrt(sum(floor**2 for floor in floors) / len(floors)) if floors else math.nan,
        "reason": one.reason or ("" if found is None or found.was_diagnosed else found.summary),
    }


def _text(name: str, value: Estimate) -> str:
    unit = "" if value.unit == "1" else f" {value.unit}"
    if not value.identified or not math.isfinite(value.stderr):
        return f"{name} = {value.value:.4g}{unit} (not determined)"
    return f"{name} = {value.value:.4g} ± {value.stderr:.2g}{unit}"


def _short(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else ""

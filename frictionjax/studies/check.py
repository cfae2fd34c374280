"""`check_diagnosis`: how often the names of a diagnosis are right on simulated machines like the user's.

Half of the machines are the diagnosed one; the others are what the names are commonly taken for, each as fitted to the
user's recordings, and the base model alone. All have the user's inputs, rates and noise, and each is diagnosed.
"""

import dataclasses
import hashlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError, Progress, reporting, require_x64
from frictionjax.core.frames import require_studies
from frictionjax.core.json import plain_json
from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.checked import Check, CheckedAnswer, CheckedName, given_name, is_right
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.intake.as_asked import case_to_diagnose, left_out_as_asked
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.recordings import Case, Plant
from frictionjax.recordings.given import CaseData
from frictionjax.studies.axes import Axis
from frictionjax.studies.design import Factorial
from frictionjax.studies.diagnosed_case import answer_of, classes_in, kept_of, text_of
from frictionjax.studies.dispatch import Submits
from frictionjax.studies.explanations import Explanation, explanations_of
from frictionjax.studies.machines_file import keep_machines, kept_machines
from frictionjax.studies.run import run_study
from frictionjax.studies.simulated_recordings import Conditions, conditions_of, recordings_like
from frictionjax.studies.study import Study, versions
from frictionjax.studies.task import AbstractTask, Block, Outcome

_FITTING = 0.05  # part of the time that the machines take, of which the diagnoses take most


@dataclasses.dataclass(frozen=True, eq=False)
class LikeYoursTask(AbstractTask):
    """Simulate a machine under the conditions of a user's recordings and diagnose it.

    The axis `draw` numbers the machines: even draws are of the first of `machines`, odd ones of the others in turn.
    Results: `acting`, the names of the effects that act beyond the base model; and those of `answer_of`.

    **Attributes:**

    - `case`: the user's case, with what is known of the machine.
    - `conditions`: of its recordings, the fitted ones first.
    - `machines`: what may be behind them, the diagnosed one first.
    - `without`: names of effects that the user rejects.
    - `rule`, `effort`: of the diagnoses.
    - `asked`: a digest of all of this but the machines.
    - `units`: name of a result -> its unit.
    """

    case: Case
    conditions: Conditions
    machines: tuple[Explanation, ...]
    without: tuple[str, ...]
    rule: Rule
    effort: Effort
    asked: str
    units: Mapping[str, str] = dataclasses.field(default_factory=lambda: {"seconds": "s"})

    @property
    def lanes(self) -> int:
        """One machine at a time."""
        return 1

    @property
    def dims(self) -> Mapping[str, tuple[str, ...]]:
        """None: no result is an array."""
        return {}

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` for other `axes` than `draw`."""
        require_x64()
        if axes != ("draw",):
            raise InputError("it has one axis, `draw`", place="`design`", cure='Give Axis("draw", range(n))')

    def described(self) -> dict[str, Any]:
        """The digest of what was asked for, and what acts in each machine."""
        return {
            "kind": "LikeYoursTask",
            "asked": self.asked,
            "machines": [list(one.acting) for one in self.machines],
        }

    def machine(self, draw: int) -> Explanation:
        """The machine of this `draw`."""
        others = self.machines[1:]
        return others[(draw // 2) % len(others)] if draw % 2 and others else self.machines[0]

    def compute(self, seed: int, block: Block) -> Outcome:
        """Diagnose the machine of a `block`; `seed` as in `AbstractTask`."""
        machine = self.machine(int(block.columns["draw"][0]))
        rng = np.random.default_rng([seed, int(block.streams[0])])
        acting = text_of(tuple((name,) for name in machine.acting))

        def diagnosed() -> Diagnosis:
            recordings = recordings_like(self.conditions, machine.drive, machine.deflection, rng)
            case = Case(self.case.name, self.case.plant, recordings, self.case.model)
            return diagnose(case, without=self.without, progress=False, rule=self.rule, effort=self.effort)

        outcome = kept_of(diagnosed, answer_of)
        # Of a machine that could not be diagnosed it is known what acted.
        return Outcome({**outcome.values, "acting": np.array([acting], dtype=object)}, outcome.reasons)


def check_diagnosis(
    case: CaseData,
    diagnosis: Diagnosis,
    machines: int = 20,
    *,
    plant: Plant | None = None,
    known: Sequence[str] = (),
    without: Sequence[str] = (),
    store: str | Path | None = None,
    executor: Submits | None = None,
    seed: int = 0,
    progress: Progress | bool = True,
) -> Diagnosis:
    """Check a diagnosis on simulated machines like the user's: how often is a name right on such data?

    Every second machine is the diagnosed one. The others are, in turn, the base model alone and whatever each named
    effect is commonly taken for (`About.confused_with`, in both directions), refitted to the user's recordings with
    everything else free, the nearest to them first; what these recordings would not show is left out. Each has the
    inputs, rates, sensor noise, encoder step and unmeasured force of the user's recordings, and is diagnosed as they
    were. Where nothing is named all machines are the base model alone.

    With a `store`, what is finished survives whatever stops the run, and the same call goes on from there.

    **Arguments:**

    - `case`: what was diagnosed, as in `diagnose`.
    - `diagnosis`: the answer.
    - `machines`: how many are simulated and diagnosed: each takes about as long as the diagnosis itself.
    - `plant`, `known`, `without`: as they were given to `diagnose`.
    - `store`: folder that becomes a Zarr store of all answers; the machines are kept beside it, in a file of the same
      name that ends in `.json`. None: in memory only.
    - `executor`: whose workers diagnose, as in `run_study`; None: this process.
    - `seed`: of the noise.
    - `progress`: called as machines are finished; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    The `diagnosis` with its `check`, a `Check`; its `sentences` say how often each name is right.

    **Raises:**

    `InputError` where the case could not be diagnosed, and as `run_study` does; `StudyStopped`, a `KeyboardInterrupt`,
    when interrupted; `ImportError` where xarray or zarr is missing.
    """
    require_x64()
    require_studies("check_diagnosis")
    whole = case_to_diagnose(case, plant, known)
    left_out_as_asked(without)
    if isinstance(machines, bool) or not isinstance(machines, int) or machines < 1:
        raise InputError(f"`machines` is {machines!r}", cure="Give a whole number from 1 on")
    if not diagnosis.was_diagnosed:
        raise InputError(
            "nothing was diagnosed, so there is no answer to check",
            place="`diagnosis`",
            cure="Correct what its summary says first",
        )
    rule, effort = diagnosis.rule, diagnosis.effort
    asked = asked_of(whole, without=without, rule=rule, effort=effort)
    beside = None if store is None else Path(store).with_suffix(".json")
    with reporting(progress) as report:
        found = kept_machines(beside, asked, diagnosis)
        if found is None:
            with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
                found = explanations_of(
                    whole,
                    diagnosis,
                    threads,
                    lambda stage, fraction: report(stage, _FITTING * fraction),
                    rule=rule,
                    effort=effort,
                )
            keep_machines(beside, asked, found)
        recordings = whole.fit_recordings + whole.holdout_recordings
        force = 0.0 if diagnosis.unmeasured is None else diagnosis.unmeasured.force
        conditions = conditions_of(recordings, force=force, encoder_step=whole.plant.encoder_step)
        task = LikeYoursTask(whole, conditions, found, tuple(without), rule, effort, asked)
        study = Study(Factorial(Axis("draw", tuple(range(machines)))), task, seed=seed)
        results = run_study(
            study,
            store,
            executor,
            progress=lambda stage, fraction: report(stage, _FITTING + (1.0 - _FITTING) * fraction),
            chunk=1,
        )
    return dataclasses.replace(diagnosis, check=check_of(results, [one.effect for one in diagnosis.missing]))


def check_of(results: Any, names: Sequence[str]) -> Check:
    """How often the `names` of a diagnosis are right in the `results` of a study of a `LikeYoursTask`."""
    fine = ~results["failed"].values.ravel()
    rows = [
        (tuple(members[0] for members in classes_in(str(acting))), str(verdict), classes_in(str(classes)))
        for acting, verdict, classes in zip(
            *(_column(results, name)[fine] for name in ("acting", "verdict", "classes")), strict=True
        )
    ]
    checked = []
    for name in names:
        given = [(acting, classes) for acting, _, classes in rows if given_name(name, classes)]
        right = [
            any(name in members and set(members) & set(acting) for members in classes)
            for acting, classes in given
        ]
        acts = [classes for acting, _, classes in rows if name in acting]
        found = [given_name(name, classes) for classes in acts]
        checked.append(CheckedName(name, len(given), sum(right), len(acts), sum(found)))
    counts = Counter(
        (acting, verdict, tuple(members[0] for members in classes), is_right(acting, classes))
        for acting, verdict, classes in rows
    )
    order = list(dict.fromkeys(acting for acting, _, _ in rows))
    answers = [CheckedAnswer(*answer, count) for answer, count in counts.items()]
    answers.sort(key=lambda one: (order.index(one.acting), -one.machines, one.named))
    return Check(int(fine.sum()), int((~fine).sum()), tuple(checked), tuple(answers))


def asked_of(
    case: Case, *, without: Sequence[str] = (), rule: Rule = Rule(), effort: Effort = Effort()
) -> str:
    """A digest of what is asked for: the recordings of the `case`, its plant and model, the effects `without` which it
    is diagnosed, `rule` and `effort`, and the versions of the programs."""
    found = hashlib.sha256()
    for one in case.recordings:
        found.update(
            repr((one.name, one.sample_rate, one.role, one.loop, one.drive, one.start_time)).encode()
        )
        for channel in (one.u, one.x, one.force, one.temperature):
            found.update(b"-" if channel is None else np.ascontiguousarray(channel).tobytes())
    known = plain_json([case.name, case.plant, case.model, without, versions()])
    found.update(repr((known, rule, effort)).encode())
    return found.hexdigest()[:16]


def _column(results: Any, name: str) -> np.ndarray:
    """One of the `results` by its `name`; empty texts where no machine could be diagnosed."""
    if name in results:
        return results[name].values.ravel()
    return np.full(results["failed"].size, "", dtype=object)

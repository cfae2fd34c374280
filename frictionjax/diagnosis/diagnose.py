"""`diagnose`: from a case to a verdict; the table of contents of a diagnosis."""

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate, Progress, reporting, require_x64, silent
from frictionjax.core.compile_time import CompileClock, Stages
from frictionjax.diagnosis.base_model.carried import carried
from frictionjax.diagnosis.base_model.credibility import credibility
from frictionjax.diagnosis.base_model.fit_base import base_of, message_of, parameters_of, said_of_errors
from frictionjax.diagnosis.base_model.input_hold import base_with_likelier_hold
from frictionjax.diagnosis.base_model.likeliest import said_of_the_sensor
from frictionjax.diagnosis.base_model.refusal import mistake, what_to_check
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.input_needed import (
    NOT_DRIVEN,
    NOT_USED,
    input_is_needed,
    with_and_without_input,
)
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.model import Model, scene_of
from frictionjax.diagnosis.evidence.recording_fits import recording_fits
from frictionjax.diagnosis.evidence.views import View, view
from frictionjax.diagnosis.findings.as_given import (
    BOTH,
    as_given,
    drive_as_given,
    simulation_as_given,
    where_it_misses,
)
from frictionjax.diagnosis.findings.candidates import candidates
from frictionjax.diagnosis.findings.ceiling import ceiling_of
from frictionjax.diagnosis.findings.closed_loop import closed_loops
from frictionjax.diagnosis.findings.missing import missing_effects, where_each_acts
from frictionjax.diagnosis.findings.next_experiment import experiments_for
from frictionjax.diagnosis.findings.not_diagnosed import not_diagnosed
from frictionjax.diagnosis.findings.other_shape import (
    other_shape_note,
    over_position,
    without_other_shapes,
)
from frictionjax.diagnosis.findings.residual_map import (
    map_is_used,
    map_tables,
    rejected_note,
    residual_model,
    with_and_without_map,
)
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.findings.unexplained import unexplained_of
from frictionjax.diagnosis.findings.unmeasured import unmeasured_force
from frictionjax.diagnosis.intake.as_asked import case_to_diagnose, left_out_as_asked
from frictionjax.diagnosis.intake.coverage import idle_effects, not_testable
from frictionjax.diagnosis.intake.starting_point import StartingPoint, check, starting_point
from frictionjax.diagnosis.mismatch_map.locate import grid_along
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.resonance import is_coherent
from frictionjax.diagnosis.selection.conclusion import (
    CEILING,
    SHAPE,
    below_ceiling,
    of_another_shape,
    tables_of,
)
from frictionjax.diagnosis.selection.model_spread import moved
from frictionjax.diagnosis.selection.select import select
from frictionjax.diagnosis.table import ModelComparison
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.estimation.start.force_balance import Balanced, force_balance
from frictionjax.recordings import Case, Plant
from frictionjax.recordings.given import CaseData

_UNDETERMINED = (
    "The base model fits every recording when all are fitted together, but not when only the fit recordings are used. "
    "No extra physics is needed; the fit recordings leave a parameter undetermined. Add one like the held-out "
    "recordings."
)
_NOT_MEANINGFUL = (
    "Without {} the base model predicts no better than assuming constant velocity; its own parameters are not "
    "meaningful."
)


def diagnose(
    case: CaseData,
    *,
    plant: Plant | None = None,
    known: Sequence[str] = (),
    without: Sequence[str] = (),
    executor: Executor | None = None,
    progress: Progress | bool = True,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> Diagnosis:
    """Locate the mismatch between recordings and base model, name the missing physics, and verify it on held-out data.

    **Arguments:**

    - `case`: a `Case`; the path of a case file or of a recording; recordings, or tables in memory such as DataFrames.
        At least one recording must be held out: of a single one that is the last third, with a warning.
    - `plant`: what is known of the machine, where `case` does not say it.
    - `known`: names of effects that act, as `[model]` of a case file has them: they become part of the base model, with
        their sizes free, and the rest is judged again.
    - `without`: names of effects that do not act: they are tested, but not named.
    - `executor`: any `concurrent.futures.Executor` that shares memory; runs tests and refits in parallel. None: a
      thread for each core of this machine.
    - `progress`: called with the stage and the fraction done; True: a bar on a terminal and in a notebook; False:
        nothing.
    - `rule`: every number that decides what is said.
    - `effort`: budgets of the search.

    **Returns:**

    A `Diagnosis`.

    **Raises:**

    `InputError` for a case that cannot be diagnosed, and for an effect that is not in the catalogue; `PrecisionError`
    unless JAX computes in float64.
    """
    require_x64()
    whole = case_to_diagnose(case, plant, known)
    rejected = left_out_as_asked(without)
    check(whole, rule=rule, effort=effort)
    threads = ThreadPoolExecutor(os.cpu_count() or 1) if executor is None else None
    try:
        with reporting(progress) as report:
            return _diagnose(whole, rejected, threads or executor, report, rule, effort)  # type: ignore[arg-type]
    finally:
        if threads is not None:
            threads.shutdown(cancel_futures=True)


def _diagnose(
    case: Case, rejected: dict[str, str], executor: Executor, progress: Progress, rule: Rule, effort: Effort
) -> Diagnosis:
    clock, compiling = Stages(), CompileClock()
    progress("starting values", 0.0)
    starting = starting_point(case)
    clock.stage("start")

    def progress_of_base(stage: str, fraction: float) -> None:
        progress(stage, 0.02 + 0.2 * fraction)

    case, starting, base, said, tables = base_with_likelier_hold(
        case, starting, executor, progress_of_base, rule=rule
    )
    plant = case.plant
    units = {"force": plant.force_unit, "position": plant.position_unit, "input": plant.input_unit}
    credible, error = credibility(base, rule=rule), ""
    decided = [credible.decision]
    untestable, barred_forms = not_testable(case, starting.batch, rule=rule)
    untestable |= rejected
    untestable |= {effect.name: "it is part of the base model" for effect in starting.own.effects}
    left_out = barred_forms | frozenset(idle_effects() if starting.imposed else ())
    balanced, heavy = _balanced(case, starting, left_out | frozenset(untestable)), None
    if not credible.is_credible(rule=rule):
        heavy = carried(starting, balanced(), executor, progress_of_base, rule=rule)
        if heavy is not None:
            base, balanced = heavy.base, lambda: heavy.forces
            credible = credibility(base, rule=rule)
            decided.append(credible.decision)
        else:
            progress("checking sign and inertia", 0.2)
            error = mistake(case, lambda other: _base_alone(other, executor, rule), rule=rule)
    notes = [*starting.notes, *said, *said_of_the_sensor(base.posterior)]
    scene = scene_of(base, starting.names)
    clock.stage("base fit")
    selection = None
    if not error:
        selection = select(
            base,
            executor,
            lambda stage, fraction: progress(stage, 0.22 + 0.66 * fraction),
            without=left_out,
            barred=frozenset(untestable),
            stick_inertia=starting.start.stick_inertia,
            balanced=balanced,
            carried=heavy is not None,
            turn=plant.turn,
            rule=rule,
            effort=effort,
        )
        progress("forces of the position", 0.88)
        selection = without_other_shapes(selection, executor, rule=rule, effort=effort)
    clock.stage("naming")
    steps = selection.steps if selection is not None else []
    accepted = [step.accepted for step in steps if step.accepted is not None]
    if selection is None or not credible.is_credible(rule=rule):
        # The missing effect may be most of the force: gravity on a pendulum.
        if selection is None or not accepted or not _is_credible(accepted[-1].model, rule):
            values = parameters_of(base, units, lacking=True)
            warnings = (
                what_to_check(credible, case, error),
                *_warnings(case, values, message_of(base), starting.notes),
            )
            base_view = view(base.judgement, scene, far=True)
            clock.stage("judging")
            seconds = clock.report(compiling)
            own = tuple(tables), tuple(decided)
            return not_diagnosed(case, base, scene, base_view, values, warnings, error, seconds, *own, steps)
        notes.append(_NOT_MEANINGFUL.format(", ".join(found.effect for found in accepted)))
    base = steps[0].before
    last = accepted[-1].model if accepted else base
    decision = selection.decision
    if steps[0].together:
        notes.append(_UNDETERMINED)
    ceiling, afterwards = None, dict[str, ModelComparison | None]()
    if decision.verdict != "named" or decision.remains:
        progress("what any force would explain", 0.88)
        own = scene_of(last, starting.names)
        ceiling, free = ceiling_of(last, own, _since(starting), base=base, rule=rule)
        afterwards[CEILING] = free
        decision = below_ceiling(decision, free, rule)
    clock.stage("ceiling")
    residual = None
    if decision.verdict == "unknown":
        progress("mapping the residual force", 0.89)
        residual = residual_model(last, steps[-1].floor, executor, base=base, rule=rule, effort=effort)
        tables = (*tables, *map_tables(residual))
        clock.stage("unknown")
    final = residual.model if residual is not None and residual.helps else last
    progress("predicting every recording", 0.93)
    scene = scene_of(final, starting.names)

    def parameters(model: Model) -> Future:
        # A map stands for what is missing, and its many ordinates take long.
        lacking = model is not last or model is base is not final
        return executor.submit(parameters_of, model, units, lacking=lacking)

    of_base, of_final = parameters(base), None if final is base else parameters(final)
    base_view, extended_view = _views(base, final, scene)
    decided.append(with_and_without_input(final, extended_view, scene))
    if not input_is_needed(decided[-1], rule):
        values = of_base.result()
        warnings = _warnings(case, values, message_of(base), tuple(notes))
        clock.stage("judging")
        seconds, own = clock.report(compiling), ((*tables, *selection.tables), tuple(decided))
        said = NOT_USED if is_coherent(base.posterior.batch) else NOT_DRIVEN  # type: ignore[arg-type]
        return not_diagnosed(case, base, scene, base_view, values, warnings, said, seconds, *own)
    if residual is not None and residual.helps:
        last_view = base_view if last is base else view(last.judgement, scene, far=True)
        decided.append(with_and_without_map(last_view, extended_view, scene))
        if not map_is_used(decided[-1]):
            notes.append(rejected_note(residual, decided[-1]))
            residual, final, extended_view = None, last, last_view
            of_final = None if final is base else parameters(final)
    floor, mapping, of_named = steps[-1].floor, executor.map, of_final
    if residual is not None and accepted:
        found = over_position(residual, base, last, floor, rule=rule)
        if found is not None:
            afterwards[SHAPE], names = found
            alone, decision = decision.share, of_another_shape(decision, afterwards[SHAPE], rule)
            if decision.verdict == "named":
                of_named = parameters(last)
                notes.append(other_shape_note(names, alone, decision.share))
    progress("mapping the mismatch", 0.97)
    grid = grid_along(base_view, base.judgement.drive, plant, scene, floor, mapping, rule=rule)
    located = grid.located(base_view, extended_view, rule=rule)
    bins = located.bins
    base_parameters, extended = of_base.result(), (of_final or of_base).result()
    extended, biased = moved(extended, last.posterior.layout, steps, rule=rule)
    sizes, _ = moved((of_named or of_base).result(), last.posterior.layout, steps, rule=rule)
    notes += [text for text in (said_of_errors(final), biased) if text]
    experiments, without_experiment = experiments_for(steps, progress)
    notes += without_experiment
    views = [(base, base_view), (final, extended_view)]
    places = [located.where] if len(accepted) == 1 else where_each_acts(steps, grid, views, rule=rule)
    missing = missing_effects(steps, decision.evidence, sizes, places, experiments)
    unexplained = unexplained_of(decision, bins, residual, rule=rule)
    unmeasured = unmeasured_force(last, steps[-1].force)
    beyond = final.judgement.drive.effects[len(base.judgement.drive.effects) :]
    silent = tuple(effect.silenced() for effect in beyond)
    given, drive = as_given(starting, scene, silent), base.judgement.drive
    models = {"base": drive.with_effects(*silent), "extended": final.judgement.drive}
    if starting.own.complete:
        models["given"] = drive_as_given(starting, silent)
    closed = closed_loops(case.controller, starting.recordings, scene, models, executor)
    fits = recording_fits(starting.recordings, scene, base_view, extended_view, drive, given, closed)
    misses = where_it_misses(given, base_view, base.judgement.drive, plant, scene, floor, mapping, rule=rule)
    compared = simulation_as_given(given, fits, plant, misses, extended=final is not base)
    if given is not None and given.source == "column" and starting.own.complete:
        notes.append(BOTH)
    clock.stage("judging")
    return Diagnosis(
        case=case.name,
        plant=plant,
        verdict=decision.verdict,
        summary=summary_sentence(
            decision.verdict,
            missing,
            unexplained,
            located.where,
            fits,
            unmeasured,
            plant.shown_force,
            ceiling,
            position_unit=plant.shown_position,
            given=compared,
            rule=rule,
        ),
        missing=missing,
        unexplained=unexplained,
        mismatch=bins,
        base=base_parameters,
        extended=extended,
        recordings=fits,
        candidates=candidates(steps, units, untestable, rule=rule),
        warnings=_warnings(case, base_parameters, message_of(base), tuple(notes)),
        seconds=clock.report(compiling),
        within=located.within,
        comparisons=(*selection.tables, *tables, *tables_of(afterwards, decision.rounds)),
        decided=tuple(decided),
        rule=rule,
        effort=effort,
        unmeasured=unmeasured,
        ceiling=ceiling,
        given=compared,
    )


def _since(starting: StartingPoint) -> Float[np.ndarray, " r"]:
    """Time since power-on of the first sample of each recording, s; zero where it is not known."""
    return np.array([recording.start_time or 0.0 for recording in starting.recordings])


def _balanced(
    case: Case, starting: StartingPoint, without: frozenset[str]
) -> Callable[[], tuple[Balanced, ...]]:
    """What gives the forces that the force balance of the `case` asks for; none where the motion is imposed, or the
    user's own model has effects."""
    if starting.imposed or starting.own.effects:
        return tuple
    return functools.partial(
        force_balance,
        case.fit_recordings,
        starting.start.drives,
        inertia=case.plant.inertia,
        without=without,
        turn=case.plant.turn,
    )


def _views(base: Model, final: Model, scene: Scene) -> tuple[View, View]:
    """What base and final model predict for all recordings. The base model gets what the final one has beyond it at
    zero strength, so that both share one compiled program."""
    extended = view(final.judgement, scene, far=True)
    if final is base:
        return extended, extended
    own = len(base.judgement.drive.effects)
    silent_effects = [effect.silenced() for effect in final.judgement.drive.effects[own:]]
    structure = base.judgement.drive.with_effects(*silent_effects)
    return view(eqx.tree_at(lambda j: j.drive, base.judgement, structure), scene, far=True), extended


def _base_alone(case: Case, executor: Executor, rule: Rule) -> Model:
    """The base model fitted to a corrected case."""
    return base_of(starting_point(case), executor, silent, rule=rule)


def _is_credible(model: Model, rule: Rule) -> bool:
    return credibility(model, rule=rule).is_credible(rule=rule)


def _warnings(case: Case, base: dict[str, Estimate], message: str, notes: tuple[str, ...]) -> tuple[str, ...]:
    warnings = [f"{r.name}: {text}" for r in case.recordings for text in r.warnings]
    warnings += list(notes)
    unidentified = [name for name, estimate in base.items() if not estimate.identified]
    if unidentified:
        names = ", ".join(unidentified)
        warnings.append(f"Not identifiable from these recordings: {names} of the base model.")
    if message:
        warnings.append(f"Base fit: {message}")
    return tuple(dict.fromkeys(warnings))

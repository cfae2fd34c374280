"""Refit: the short list of candidates, converged with all parameters free, and judged."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, has_contacts
from frictionjax.diagnosis.evidence.step_length import steps_needed, with_steps
from frictionjax.diagnosis.refitting.backlash_search import heavier, load_ratio, searched, told
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.refitting.shortlist import behind_gaps
from frictionjax.diagnosis.screening.resonance import Pair
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.estimation.descent.robust import Ending, Fitted, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH, SLOW_BANDWIDTH, extend
from frictionjax.estimation.parameters import changed
from frictionjax.physics.effects import AbstractLoadEffect

_LEFT = 0.2  # part of the present misfit: when all refits leave more of it, they get a second start

_FAR = 0.1  # misfit of a model that may sit in a wrong minimum

_ALREADY = 0.3  # part of the present misfit: what leaves less after its first steps needs no other start

_NEAR = 0.25  # part of the best refit's gain with the fast observer that brings another on to the slow one

_FIRST = 5  # steps after which candidates that lag behind are given up

_PROMISING = 0.2  # part of the best one's gain by then

_AT_LEAST = 3  # candidates that go on in any case

_HOPELESS = 0.1  # part of the present misfit: what gains less of it in twelve steps will not gain half


def refit_all(
    trials: list[Trial],
    model: Model,
    scales: dict[str, float],
    executor: Executor,
    pair: Pair | None = None,
    absorbed: Sequence[Trial] = (),
    hanging: Sequence[Trial] = (),
    stick_inertia: float | None = None,
) -> list[Refitted]:
    """Refit `trials`, each an effect beside those of `model`, from their one-step estimates: all with the fast
    observer, and those that come near the best of them with the slow one.

    A base model with something missing may have come to rest far from the truth, and a candidate that starts there may
    look refuted. Where the best leaves most of the misfit of the base model, they are fitted again from where its fit
    began, with as much of the effect as its test promised, or as the `pair` shows; and so are the `absorbed` ones, from
    a plain size and the base parameters that undo most of it.

    **Arguments:**

    - `trials`: the short list.
    - `model`: the model without them.
    - `scales`: the plant's sizes.
    - `executor`: runs them side by side.
    - `pair`: antiresonance and resonance in the data, where they show any.
    - `absorbed`: what the base parameters can stand in for (`hidden_in_the_base`).
    - `hanging`: tests of a load behind a gap, one a form: it is searched (`diagnosis.search`) where nothing explains
        most and stick lacks a part of the inertia, or where it is among the `trials`.
    - `stick_inertia`: the inertia that noise in stick shows, where a recording has some.
    """
    fast = model.joint.at_bandwidth(FAST_BANDWIDTH)
    present = float(fast.misfits([model.fitted.vector])[0])
    # Under an imposed motion nothing helps a wrong model along its way: each minimum of the base model has a wall.
    graduate = model.joint.batch.imposed

    def begin(trial: Trial) -> tuple[Posterior, Fitted]:
        joint, vector = extend(fast, model.fitted.vector, trial.form, scales)
        alone = vector
        vector = _placed(joint, vector, trial.vector)
        if graduate:
            return joint, lowest(joint, [vector, *other_starts(joint, vector)])
        found = first_steps(joint, [vector])
        if not found.misfit > max(_FAR, _ALREADY * present):
            return joint, found
        # Far from the noise one step for all parameters may lead astray: those of the model stay where they were.
        own = slice(len(model.joint.layout), len(joint.layout))
        hangs = isinstance(trial.form, AbstractLoadEffect)
        starts = [uncoupled(joint, one) if hangs else one for one in other_starts(joint, alone)]
        other = first_steps(joint, [changed(alone, own, np.asarray(trial.vector)[own]), *starts])
        return joint, min(found, other, key=lambda fitted: fitted.misfit)

    def other_starts(joint: Posterior, vector) -> list:
        """`vector` with the parameters of the effect where a refit of it begins besides."""
        start = vector
        for place in range(len(model.joint.layout), len(joint.layout)):
            own = joint.layout[place].parameter
            if own.other_start is None:
                continue
            unit = own.scale if isinstance(own.scale, float) else scales[str(own.scale)]
            value = np.log(own.other_start * unit) if own.transform == "log" else own.other_start
            start = changed(start, place, value)
        return [] if start is vector else [start]

    def lowest(joint: Posterior, starts: list) -> Fitted:
        ends = [descend(joint, start, steps=12, tolerance=0.03) for start in starts]
        return min(ends, key=lambda fitted: fitted.misfit)

    def first_steps(joint: Posterior, starts: list) -> Fitted:
        # From a step that gains wide knees lead no further than the noise's own.
        ends = [descend(joint, start, graduate=False, steps=_FIRST, tolerance=0.03) for start in starts]
        return min(ends, key=lambda fitted: fitted.misfit)

    def go_on(begun: tuple[Posterior, Fitted]) -> tuple[Posterior, Fitted]:
        joint, found = begun
        if graduate or found.ending in (Ending.AT_REST, Ending.NO_STEP):
            return begun
        return joint, descend(joint, found.vector, graduate=False, steps=12 - _FIRST, tolerance=0.03)

    def again(trial: Trial, begun: tuple[Posterior, Fitted]) -> tuple[Posterior, Fitted]:
        joint, found = begun
        own = slice(len(model.joint.layout), len(joint.layout))
        start = changed(joint.start, own, np.asarray(trial.vector)[own])
        if pair is not None and isinstance(trial.form, AbstractLoadEffect):
            shown = {"ratio": pair.ratio, "frequency": np.log(pair.frequency)}
            for place in range(own.start, own.stop):
                name = joint.layout[place].parameter.name
                start = changed(start, place, shown[name]) if name in shown else start
        other = lowest(joint, [start, *other_starts(joint, start)])
        return joint, min(found, other, key=lambda fitted: fitted.misfit)

    def sought(trial: Trial) -> tuple[Posterior, Fitted] | None:
        joint, vector = extend(fast, model.fitted.vector, trial.form, scales)
        found = searched(joint.at_bandwidth(SLOW_BANDWIDTH), vector, scales["zs"], ratio)
        return None if found is None else (joint, descend(joint, found, graduate=False, steps=0))

    def along_the_valley(trial: Trial) -> tuple[Posterior, Fitted]:
        joint, vector = extend(fast, model.fitted.vector, trial.form, scales)
        return joint, descend(joint, _placed(joint, vector, trial.valley), steps=_FIRST, tolerance=0.03)

    def finish(pair: tuple[Trial, tuple[Posterior, Fitted]]) -> Refitted:
        trial, (joint, found) = pair
        slow, chaotic = joint.at_bandwidth(SLOW_BANDWIDTH), has_contacts(trial.form)
        if chaotic:
            # Contacts are shorter than anything else in the machine.
            slow = told(slow, found.vector)
            slow = told(with_steps(slow, steps_needed(slow, found.vector)), found.vector)
        fitted = descend(slow, found.vector, graduate=False, steps=15, tolerance=0.01)
        return Refitted(trial, Model(slow, fitted, judge(slow, fitted)))

    if not trials:
        return []
    begun = _longest_first(executor, begin, trials)
    ratio = load_ratio(model.joint, model.fitted.vector, stick_inertia)
    chaotic = behind_gaps(trials)
    if ratio is not None:
        chaotic += [trial for trial in hanging if trial.effect not in {other.effect for other in chaotic}]
    trials, begun = _foremost(trials, begun, present, _PROMISING)
    begun = list(executor.map(go_on, begun))
    # A model that has effects already has left the minimum that the base model came to rest in.
    stuck = min(found.misfit for _, found in begun) > _LEFT * present and present > _FAR
    if stuck and not model.joint.drive.effects:
        trials, begun = _foremost(trials, begun, present, _NEAR)
        begun = list(executor.map(again, trials, begun))
        begun, trials = begun + list(executor.map(along_the_valley, absorbed)), [*trials, *absorbed]
    if stuck and min(found.misfit for _, found in begun) > _LEFT * present:
        ends = [
            (trial, end) for trial, end in zip(chaotic, executor.map(sought, chaotic), strict=True) if end
        ]
        begun, trials = begun + [end for _, end in ends], trials + [trial for trial, _ in ends]
    gains = np.array([present - found.misfit for _, found in begun])
    if model.joint.drive.effects and gains.max() < _HOPELESS * present:
        # One of them goes on, to be shown; none will be named beside the effects that are.
        best = int(np.argmax(gains))
        trials, begun, gains = [trials[best]], [begun[best]], gains[best:][:1]
    # A form may have begun from two places: the better end goes on.
    better: dict[str, tuple[float, Trial, tuple[Posterior, Fitted]]] = {}
    for trial, end, gain in zip(trials, begun, gains, strict=True):
        form = type(trial.form).__name__
        if gain > _NEAR * gains.max() and (form not in better or gain > better[form][0]):
            better[form] = gain, trial, end
    return list(executor.map(finish, [(trial, end) for _, trial, end in better.values()]))


def _longest_first(
    executor: Executor, begin: Callable[[Trial], tuple[Posterior, Fitted]], trials: list[Trial]
) -> list[tuple[Posterior, Fitted]]:
    """What `begin` makes of each of the `trials`, in their order. Those with the most parameters are begun first: begun
    last, the slowest of all would keep one core busy while the others wait."""
    order = sorted(range(len(trials)), key=lambda number: -len(trials[number].vector))
    done = executor.map(begin, [trials[number] for number in order])
    return [made for _, made in sorted(zip(order, done, strict=True), key=lambda pair: pair[0])]


def _placed(joint: Posterior, vector: Float[Array, " q"], told: Float[Array, " p"]) -> Float[Array, " q"]:
    """`vector` with what a test told: parameters, and the starting deflections of the fitted recordings."""
    count, rows = len(joint.layout), np.flatnonzero(np.asarray(joint.fitted[0]) > 0)
    places = np.concatenate([np.arange(count), count + rows])
    return changed(vector, places, told)


def uncoupled(joint: Posterior, vector: Float[Array, " q"]) -> Float[Array, " q"]:
    """`vector` of a machine with a second inertia, with the inertia that it has taken for that of the motor alone, as
    it shows where the load hangs in its gap most of the time: J is larger, stiffness and damping are what they were."""
    load = joint.drive_of(vector).load_side
    assert load is not None
    return heavier(joint, vector, 1.0 / (1.0 - load.ratio))


def _foremost(
    trials: list[Trial], begun: list[tuple[Posterior, Fitted]], present: float, part: float
) -> tuple[list[Trial], list[tuple[Posterior, Fitted]]]:
    """Those that gain more than `part` of what the best one gains on the misfit `present`, and the first three."""
    order = sorted(range(len(begun)), key=lambda number: begun[number][1].misfit)
    most = present - begun[order[0]][1].misfit
    kept = [
        number
        for place, number in enumerate(order)
        if place < _AT_LEAST or present - begun[number][1].misfit > part * most
    ]
    return [trials[number] for number in kept], [begun[number] for number in kept]

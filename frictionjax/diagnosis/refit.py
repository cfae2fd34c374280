"""Refit: the short list of candidates, converged with all parameters free, and judged."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.judge import Judgement, advantage, energy_explained, explained, judge
from frictionjax.diagnosis.name import Trial
from frictionjax.diagnosis.resonance import Pair
from frictionjax.diagnosis.search import heavier, load_ratio, searched, told
from frictionjax.diagnosis.step_length import steps_needed, with_steps
from frictionjax.estimation.imposed_batch import ImposedBatch
from frictionjax.estimation.joint import FAST_BANDWIDTH, SLOW_BANDWIDTH, Joint, extend
from frictionjax.estimation.parameters import changed
from frictionjax.estimation.robust_fit import Ending, Fitted, descend
from frictionjax.physics.effects import AbstractEffect, AbstractForceEffect, AbstractLoadEffect

_LEFT = 0.2  # part of the present misfit: when all refits leave more of it, they get a second start
_FAR = 0.1  # misfit of a model that may sit in a wrong minimum
_ALREADY = 0.3  # part of the present misfit: what leaves less after its first steps needs no other start
_NEAR = 0.25  # part of the best refit's gain with the fast observer that brings another on to the slow one
_KIN = 2  # effects that are easily taken for the leader and are refitted with it, in all their forms
_EASE = (
    0.1  # of the power that a model leaves: errors below it do not count while nothing comes near the noise
)
_EASED = 0.3  # logarithm of a change of the noise that is worth a refit
_FIRST = 5  # steps after which candidates that lag behind are given up
_PROMISING = 0.2  # part of the best one's gain by then
_AT_LEAST = 3  # candidates that go on in any case
_HOPELESS = 0.1  # part of the present misfit: what gains less of it in twelve steps will not gain half
_MASKED, _PLAIN = 0.9, 1.0  # part of a step that base parameters undo; its power over that of the noise
_MOST_MASKED = 5
_KEEP = 0.1  # a candidate that gains less than this part of the best one is not refitted


class Model(eqx.Module):
    """A fitted structure: `joint` (slow observer), where the descent ended, `fitted`, and its `judgement`."""

    joint: Joint
    fitted: Fitted
    judgement: Judgement


class Refitted(eqx.Module):
    """A candidate, refitted.

    **Attributes:** `trial`, `model`.
    """

    trial: Trial
    model: Model

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.trial.effect

    @property
    def form(self) -> str:
        """Name of its form."""
        return type(self.trial.form).__name__


_WAVES, _WAVES_BESIDE = 1.0, 2.0  # along the stroke, and beside another force


class Compared(eqx.Module):
    """A refitted candidate against the model without it.

    **Attributes:** `share_fit`, `share_holdout` (share of the misfit above the floor that it removes), `energy_fit`,
    `energy_holdout` (share of the power), `lead_fit`, `lead_holdout` (gain in its standard errors, over clusters of
    0.5 s), `repeats` (whether all that is periodic along the stroke is seen to repeat in it).
    """

    share_fit: float
    share_holdout: float
    energy_fit: float
    energy_holdout: float
    lead_fit: float
    lead_holdout: float
    repeats: bool

    @property
    def worth(self) -> float:
        """Sum of the explained shares: what the candidates are ranked by."""
        return self.share_fit + self.share_holdout


def compare(before: Judgement, after: Judgement, floor: np.ndarray) -> Compared:
    """`after` against `before`, above the `floor` of each block."""
    held = before.held_out
    return Compared(
        *explained(before, after, floor),
        *energy_explained(before, after, floor),
        advantage(after, before, ~held, floor),
        advantage(after, before, held, floor),
        _repeats(after),
    )


def _repeats(found: Judgement) -> bool:
    """A wave that the stroke does not hold whole bends to any force that depends on the position; beside another force,
    a wave with its overtone bends to whatever that one leaves, unless it comes twice."""
    x = np.asarray(found.batch.x)[np.asarray(found.batch.valid) > 0.0]
    stroke = float(np.ptp(x)) if x.size else 0.0
    forces = [effect for effect in found.drive.effects if isinstance(effect, AbstractForceEffect)]
    return all(
        stroke >= (_WAVES_BESIDE if effect in forces and len(forces) > 1 else _WAVES) * abs(period)
        for effect in found.drive.effects
        for period in (float(getattr(effect, n.name)) for n in effect.nuisances if n.grid == "period")
    )


def one_of_each(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form, the highest gain first; of those that gain alike, the highest linear gain."""
    by_form: dict[tuple[str, str], Trial] = {}
    for trial in sorted(trials, key=lambda t: (-t.gain, -t.linear_gain)):
        by_form.setdefault((trial.effect, type(trial.form).__name__), trial)
    return list(by_form.values())


def short_list(trials: list[Trial], *, most: int, least_gain: float, far: bool = False) -> list[Trial]:
    """The trials worth refitting: the best trial of each form by actual gain, the two best by linear gain, and what is
    easily taken for the leader.

    **Arguments:**

    - `trials`: all trials.
    - `most`: how many forms at most.
    - `least_gain`: actual gain below which nothing is refitted.
    - `far`: the present model is far from the noise. It may sit in a minimum that no single step leaves; the forms that
        promise most are then refitted although no step towards them gains.
    """
    best = one_of_each(trials)
    if not best or best[0].gain < least_gain:
        promising = sorted(best, key=lambda t: -t.linear_gain)
        return [t for t in promising if t.linear_gain > least_gain][:most] if far else []
    kept = [t for t in best if t.gain > _KEEP * best[0].gain and t.gain > least_gain][:most]
    linear = sorted(best, key=lambda t: -t.linear_gain)[:2]
    # What is easily taken for the leader may be the truth although its first step gains less: with all its forms, for
    # the step of one may be a mirage where that of the other is none.
    lead = best[0].form
    alike = [
        t.effect
        for t in best
        if (t.effect in lead.about.confused_with or lead.name in t.form.about.confused_with)
        and t.linear_gain > least_gain
    ]
    near = list(dict.fromkeys([lead.name, *alike]))[: 1 + _KIN]
    kin = [t for t in best if t.effect in near and t.linear_gain > least_gain]
    chosen: list[Trial] = []
    for trial in kept + linear + kin:
        if np.isfinite(trial.gain) and not any(trial is one for one in chosen):
            chosen.append(trial)
    return chosen


def hidden_in_the_base(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form of which a plain step would show and the base parameters can undo most: a base fit
    may have taken it for a machine of other inertia and friction, and then no small step away from that one gains."""
    masked = [trial for trial in trials if trial.absorbed > _MASKED and trial.shown > _PLAIN]
    best: dict[str, Trial] = {}
    for trial in sorted(masked, key=lambda t: -t.absorbed):
        best.setdefault(type(trial.form).__name__, trial)
    return list(best.values())[:_MOST_MASKED]


def behind_gaps(trials: list[Trial]) -> list[Trial]:
    """The best trial of each form of a load behind a gap."""
    return one_of_each([trial for trial in trials if _is_chaotic(trial.form)])


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
    graduate = isinstance(model.joint.batch, ImposedBatch)

    def begin(trial: Trial) -> tuple[Joint, Fitted]:
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

    def other_starts(joint: Joint, vector) -> list:
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

    def lowest(joint: Joint, starts: list) -> Fitted:
        ends = [descend(joint, start, steps=12, tolerance=0.03) for start in starts]
        return min(ends, key=lambda fitted: fitted.misfit)

    def first_steps(joint: Joint, starts: list) -> Fitted:
        # From a step that gains wide knees lead no further than the noise's own.
        ends = [descend(joint, start, graduate=False, steps=_FIRST, tolerance=0.03) for start in starts]
        return min(ends, key=lambda fitted: fitted.misfit)

    def go_on(begun: tuple[Joint, Fitted]) -> tuple[Joint, Fitted]:
        joint, found = begun
        if graduate or found.ending in (Ending.AT_REST, Ending.NO_STEP):
            return begun
        return joint, descend(joint, found.vector, graduate=False, steps=12 - _FIRST, tolerance=0.03)

    def again(trial: Trial, begun: tuple[Joint, Fitted]) -> tuple[Joint, Fitted]:
        joint, found = begun
        own = slice(len(model.joint.layout), len(joint.layout))
        start = changed(joint.setting.start, own, np.asarray(trial.vector)[own])
        if pair is not None and isinstance(trial.form, AbstractLoadEffect):
            shown = {"ratio": pair.ratio, "frequency": np.log(pair.frequency)}
            for place in range(own.start, own.stop):
                name = joint.layout[place].parameter.name
                start = changed(start, place, shown[name]) if name in shown else start
        other = lowest(joint, [start, *other_starts(joint, start)])
        return joint, min(found, other, key=lambda fitted: fitted.misfit)

    def sought(trial: Trial) -> tuple[Joint, Fitted] | None:
        joint, vector = extend(fast, model.fitted.vector, trial.form, scales)
        found = searched(joint.at_bandwidth(SLOW_BANDWIDTH), vector, scales["zs"], ratio)
        return None if found is None else (joint, descend(joint, found, graduate=False, steps=0))

    def along_the_valley(trial: Trial) -> tuple[Joint, Fitted]:
        joint, vector = extend(fast, model.fitted.vector, trial.form, scales)
        return joint, descend(joint, _placed(joint, vector, trial.valley), steps=_FIRST, tolerance=0.03)

    def finish(pair: tuple[Trial, tuple[Joint, Fitted]]) -> Refitted:
        trial, (joint, found) = pair
        slow, chaotic = joint.at_bandwidth(SLOW_BANDWIDTH), _is_chaotic(trial.form)
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
    if stuck and not model.joint.setting.drive.effects:
        trials, begun = _foremost(trials, begun, present, _NEAR)
        begun = list(executor.map(again, trials, begun))
        begun, trials = begun + list(executor.map(along_the_valley, absorbed)), [*trials, *absorbed]
    if stuck and min(found.misfit for _, found in begun) > _LEFT * present:
        ends = [
            (trial, end) for trial, end in zip(chaotic, executor.map(sought, chaotic), strict=True) if end
        ]
        begun, trials = begun + [end for _, end in ends], trials + [trial for trial, _ in ends]
    gains = np.array([present - found.misfit for _, found in begun])
    if model.joint.setting.drive.effects and gains.max() < _HOPELESS * present:
        # One of them goes on, to be shown; none will be named beside the effects that are.
        best = int(np.argmax(gains))
        trials, begun, gains = [trials[best]], [begun[best]], gains[best:][:1]
    # A form may have begun from two places: the better end goes on.
    better: dict[str, tuple[float, Trial, tuple[Joint, Fitted]]] = {}
    for trial, end, gain in zip(trials, begun, gains, strict=True):
        form = type(trial.form).__name__
        if gain > _NEAR * gains.max() and (form not in better or gain > better[form][0]):
            better[form] = gain, trial, end
    return list(executor.map(finish, [(trial, end) for _, trial, end in better.values()]))


def _longest_first(
    executor: Executor, begin: Callable[[Trial], tuple[Joint, Fitted]], trials: list[Trial]
) -> list[tuple[Joint, Fitted]]:
    """What `begin` makes of each of the `trials`, in their order. Those with the most parameters are begun first: begun
    last, the slowest of all would keep one core busy while the others wait."""
    order = sorted(range(len(trials)), key=lambda number: -len(trials[number].vector))
    done = executor.map(begin, [trials[number] for number in order])
    return [made for _, made in sorted(zip(order, done, strict=True), key=lambda pair: pair[0])]


def _placed(joint: Joint, vector: Float[Array, " q"], told: Float[Array, " p"]) -> Float[Array, " q"]:
    """`vector` with what a test told: parameters, and the starting deflections of the fitted recordings."""
    count, rows = len(joint.layout), np.flatnonzero(np.asarray(joint.fitted) > 0)
    places = np.concatenate([np.arange(count), count + rows])
    return changed(vector, places, told)


def is_chaotic(model: Model) -> bool:
    """Whether contacts make the motion of the `model` chaotic."""
    return any(_is_chaotic(effect) for effect in model.judgement.drive.effects)


def _is_chaotic(effect: AbstractEffect) -> bool:
    return isinstance(effect, AbstractLoadEffect) and effect.chaotic


def uncoupled(joint: Joint, vector: Float[Array, " q"]) -> Float[Array, " q"]:
    """`vector` of a machine with a second inertia, with the inertia that it has taken for that of the motor alone, as
    it shows where the load hangs in its gap most of the time: J is larger, stiffness and damping are what they were."""
    load = joint.drive(vector).load_side
    assert load is not None
    return heavier(joint, vector, 1.0 / (1.0 - load.ratio))


def _foremost(
    trials: list[Trial], begun: list[tuple[Joint, Fitted]], present: float, part: float
) -> tuple[list[Trial], list[tuple[Joint, Fitted]]]:
    """Those that gain more than `part` of what the best one gains on the misfit `present`, and the first three."""
    order = sorted(range(len(begun)), key=lambda number: begun[number][1].misfit)
    most = present - begun[order[0]][1].misfit
    kept = [
        number
        for place, number in enumerate(order)
        if place < _AT_LEAST or present - begun[number][1].misfit > part * most
    ]
    return [trials[number] for number in kept], [begun[number] for number in kept]


def polish(candidate: Refitted) -> Refitted:
    """The same refit, converged: for those that may be named."""
    model = candidate.model
    fitted = descend(model.joint, model.fitted.vector, graduate=False, steps=25)
    return Refitted(candidate.trial, Model(model.joint, fitted, judge(model.joint, fitted)))


def ease(model: Model) -> Model:
    """The same model, refitted where it is far from the noise of an imposed motion's force: errors are then weighed
    against a third of what it leaves in the middle one of the blocks, and a step of the selection sees which candidate
    takes off most of them.

    Against the noise the cost of a block is the logarithm of its error. A model that is everywhere fifty times worse
    would be fitted to the blocks in which its error happens to pass through zero.
    """
    batch = model.joint.batch
    if not isinstance(batch, ImposedBatch):
        return model
    scored = (np.asarray(batch.block_count) > 0) & (np.asarray(model.joint.fitted)[:, None] > 0)
    wanted = max(np.sqrt(_EASE * float(np.median(model.judgement.power[scored]))), 1.0)
    if abs(np.log(wanted / float(batch.ease[0]))) < _EASED:
        return model
    joint = eqx.tree_at(lambda j: j.setting.batch.ease, model.joint, jnp.full_like(batch.ease, wanted))
    fitted = descend(joint, model.fitted.vector, graduate=False)
    return Model(joint, fitted, judge(joint, fitted))

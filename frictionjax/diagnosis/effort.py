"""The effort: budgets of the search for what is missing. A budget may cost a name, and never makes one.

What is named is decided by the `Rule` alone, of what was refitted. These numbers say how much is tested, simulated and
refitted, and when a candidate is given up early. All were set by hand, by the time that a diagnosis takes.
"""

import dataclasses


@dataclasses.dataclass(frozen=True)
class ScreeningEffort:
    """What of the catalogue is simulated and refitted.

    **Attributes:**

    - `least_promise`: linear gain per sample that is worth a simulation.
    - `faint`: the same over the largest linear gain of all effects: what is missing promises more than it gains, and
      next to what promises fifty times as much it is not what is missing.
    - `level`: misfit from which effects are also tested where the model misses all regimes alike.
    - `least_gain`: drop of the misfit per sample that is worth a refit.
    - `first_forms`, `later_forms`: how many forms are refitted for their gain, in the first round and later.
    - `linear_forms`: how many for their linear gain.
    - `keep`: part of the best one's gain that a form must have.
    - `related`: how many effects that are confused with the leader are refitted with it, in all their forms.
    - `far`: misfit from which the forms that promise most are refitted although none gains.
    - `cornered`: misfit from which, under an imposed motion, every form is refitted.
    - `fewest_waves`: along the stroke: longer periods are not tested; they are a spring or a slope.
    - `absorbed`: part of a step that base parameters undo, from which the base fit may have absorbed the effect.
    - `visible`: power of that step over the noise.
    - `most_absorbed`: how many such forms are refitted.
    """

    least_promise: float = 1e-4
    faint: float = 0.02
    level: float = 0.2
    least_gain: float = 0.0005
    first_forms: int = 5
    later_forms: int = 3
    linear_forms: int = 2
    keep: float = 0.1
    related: int = 2
    far: float = 0.02
    cornered: float = 0.8
    fewest_waves: float = 1.25
    absorbed: float = 0.9
    visible: float = 1.0
    most_absorbed: int = 5


@dataclasses.dataclass(frozen=True)
class RefittingEffort:
    """How far candidates are refitted, and when they are given up. Parts are of the misfit of the present model.

    **Attributes:**

    - `searched_samples`: of each recording, from its first on, by which candidates are first refitted;
      the last descent of those that are left is on all samples. It is the shortest length of a program: longer ones
      are compiled for the last descent alone.
    - `searched_part`: part of the misfit of the whole that this first part must have; else the whole is searched.
    - `first_steps`: steps of a descent after which candidates that lag behind are given up.
    - `steps`: steps in all of the first descent; `tolerance`: where they end sooner.
    - `lagging`: part of the best one's gain by then; `least_kept`: candidates that go on in any case.
    - `far`: misfit of a model that may sit in a wrong minimum.
    - `settled`: part left after the first steps below which no other start is tried.
    - `left`: part that all candidates leave, above which they get other starts.
    - `near`: part of the best gain of a first descent that brings a candidate on to the last one.
    - `hopeless`: part that must be gained, beside other effects, for more than one candidate to go on.
    - `slow_steps`, `slow_tolerance`: of the last descent, with the slow observer.
    - `close`: difference of the sums of shares within which the two best are refitted until they rest.
    - `worthless`: sum of shares below which none is.
    - `polish_steps`: of that descent.
    - `better_base`: part by which a refit's parameters must improve the model without its effect to replace it, and
      `least_better`: drop of the misfit that they must bring in any case.
    - `eased`: logarithm of a change of the noise of an imposed motion that is worth a refit.
    - `residual_maps`: maps of the missing force that are refitted; `map_steps`: of each of their two descents;
      `map_tolerance`: of the first, the slow one has `slow_tolerance`.
    """

    searched_samples: int = 16_384
    searched_part: float = 0.5
    first_steps: int = 5
    steps: int = 12
    tolerance: float = 0.03
    lagging: float = 0.2
    least_kept: int = 3
    far: float = 0.1
    settled: float = 0.3
    left: float = 0.2
    near: float = 0.25
    hopeless: float = 0.1
    slow_steps: int = 15
    slow_tolerance: float = 0.01
    close: float = 0.3
    worthless: float = 0.2
    polish_steps: int = 25
    better_base: float = 0.02
    least_better: float = 1e-3
    eased: float = 0.3
    residual_maps: int = 2
    map_steps: int = 12
    map_tolerance: float = 0.02


@dataclasses.dataclass(frozen=True)
class BacklashEffort:
    """Where a load behind a gap is searched.

    **Attributes:**

    - `lightest`, `heaviest`: part of the inertia that stick must lack, at least and at most, for a load to be believed
      in.
    - `ratios`: of the load's inertia to the whole, where stick does not tell.
    - `narrowest`, `widest`, `gaps`: gaps over the bristle's break-away deflection, and how many.
    - `shares`: of the viscous friction that is the load's.
    - `turns`: scale of the Cauchy loss, and half-width of the grid around the best so far.
    - `finer_gaps`, `finer_shares`: of these grids.
    - `steps`: of a descent between two grids; `tolerance`: where it ends sooner.
    - `travel`: break-away deflections in a block of 50 ms from which a machine slides.
    - `slides`: part of the blocks of a recording that must slide.
    - `least_gain`: part of what the rigid machine costs above the noise in sliding that the first turn must gain.
    """

    lightest: float = 0.05
    heaviest: float = 0.9
    ratios: tuple[float, ...] = (0.2, 0.35, 0.5)
    narrowest: float = 0.3
    widest: float = 20.0
    gaps: int = 30
    shares: tuple[float, ...] = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)
    turns: tuple[tuple[float, float], ...] = ((10.0, 0.5), (10.0, 0.25), (1.0, 0.1))
    finer_gaps: int = 15
    finer_shares: int = 5
    steps: int = 8
    tolerance: float = 0.01
    travel: float = 10.0
    slides: float = 0.1
    least_gain: float = 0.1


@dataclasses.dataclass(frozen=True)
class Effort:
    """Budgets of a diagnosis.

    **Attributes:** `rounds` (of the stepwise selection: at most so many effects), `longest_run` (integration steps of
    all recordings together: a case that needs more is refused, as a diagnosis makes thousands of runs), `screening`,
    `refitting`, `backlash`.
    """

    rounds: int = 3
    longest_run: int = 5_000_000
    screening: ScreeningEffort = ScreeningEffort()
    refitting: RefittingEffort = RefittingEffort()
    backlash: BacklashEffort = BacklashEffort()

"""The rule: every number by which a verdict, a name, a class of names or a reported place is decided.

Search budgets stand apart (`effort.py`): a budget may cost a name, and never makes one. `python -m benchmarks.replay`
scores another rule on stored comparisons; `python -m benchmarks.mutants` shows that a test fails where a number changes
by a half.

Each number is followed by what goes wrong where it is larger, where it is smaller, and by where it was set. "By hand"
means that no study is on record: the number was chosen while single machines were looked at, and has since been judged
by the bank and the blind batches as a whole, never alone.
"""

import dataclasses


@dataclasses.dataclass(frozen=True)
class FloorRule:
    """Numbers that enter the comparisons themselves: the power of the innovations that a perfect model would leave.

    They were used when a table was made: `benchmarks.replay` cannot change them.

    **Attributes:**

    - `quantile`: of the blocks' own estimates of the unmeasured force, the one that is believed. Larger: an effect that
      raises many blocks passes for a disturbance, and is lost; smaller: a disturbance passes for physics. By hand.
    - `answering`: part of the largest answer to a force that a block must show to be asked. Larger: few blocks decide;
      smaller: blocks in stick, which say nothing of the force, decide. By hand.
    - `largest_force`: largest unmeasured force, over Coulomb friction, at each sample. Larger: an effect that acts in
      all of sliding is taken for a disturbance; smaller: a disturbed machine gets a name. By hand (commit 28da210).
    - `colour`: largest factor by which the colour of a recording's noise raises its floor. Noise nine tenths of which
      lie below 200 Hz has 2 at 2 kHz. Larger: a small effect that acts everywhere is lost; smaller: coloured noise is
      given a name. By hand.
    - `chance`: standard errors that chance may add to the growth of the noise in a block, found from a few simulations;
      below it the noise has not grown. Larger: noise that a moving machine amplifies is given a name; smaller: chance
      in the simulations raises the floor. By hand.
    - `cap`: largest answer of a block over the median answer. Larger: one block in which a break-away came sooner
      raises the floor of its neighbours; smaller: blocks that do answer more are held to too low a floor. By hand.
    - `unpredictable`: power over that of the noise by which two runs part in a block that is left out as unpredictable.
      Larger: chaos is fitted; smaller: blocks that would determine a size are left out. By hand.
    - `gap_force`: unmeasured force over Coulomb friction under which a machine with a gap must stay predictable for a
      block to count. Larger: too little is left to fit a gap by; smaller: contacts that no model predicts are fitted.
      By hand, as the search was developed on machines 5017 and 5117 of the bank.
    - `excuse_share`: share of the misfit, in the predictable blocks, that a chaotic candidate must explain for its
      chaos to be excused. Larger: backlash is lost; smaller: a wrong gap excuses its own errors. By hand.
    - `excused_part`: part of the misfit without the gap that must stay after the excuse. Larger: backlash is lost;
      smaller: chaos excuses everything. By hand.
    - `ease`: under an imposed motion, part of the power that a model leaves below which errors do not count. Larger:
      what is small does not show beside what is large; smaller: the blocks in which a large error passes through zero
      decide. By hand (commit 65242a8).
    - `energy_quantile`: of the power of the blocks, the quantile at which it is capped in shares of the energy. Larger:
      a few impacts decide; smaller: an effect that acts in one block of ten does not count. By hand.
    """

    quantile: float = 0.4
    answering: float = 0.1
    largest_force: float = 0.005
    colour: float = 2.0
    chance: float = 4.0
    cap: float = 20.0
    unpredictable: float = 1.0
    gap_force: float = 5e-4
    excuse_share: float = 0.45
    excused_part: float = 0.5
    ease: float = 0.1
    energy_quantile: float = 0.95


@dataclasses.dataclass(frozen=True)
class AcceptanceRule:
    """What a refitted candidate must show to be accepted into the model.

    **Attributes:**

    - `lead`: standard errors, over clusters of 0.5 s, by which the model with the candidate must be likelier on the
      fitted and the held-out recordings together, both with the same weight (`Improvement.lead`). Larger: short
      recordings show nothing; smaller: chance gets a name. The usual level of three.
    - `lead_each`: standard errors by which it must be likelier on the fitted and on the held-out recordings alone.
      Larger: what only a few seconds of one set show is refused; smaller: what the held-out recordings do not repeat
      gets a name (`python -m benchmarks.likelihood compare --each N`).
    - `least_share`: share of the misfit that all names together must explain, and an effect beside other names; shares
      are of the misfit above the floor, and the smaller one of the fitted and the held-out recordings counts. Larger: a
      true second effect is refused; smaller: the form of the first one, or what half resembles an effect, gets a name.
      In the first tables of 153 machines of the batches 502 to 505 and 601 and of the bank, what the likelihood takes
      first is right, or in a class with what is, in all eleven that explain 0.3 to 0.5 and in three of eight that
      explain less (`python -m benchmarks.likelihood shares FILE`).
    - `enough_share`: share after which what is left is more likely the form of what was found: another effect must then
      explain as much of the rest, and so must an effect beside a model that is adequate. It is also the share of the
      power that is enough for a name whose share of the misfit is not. Larger: second names beside a right one;
      smaller: a true second effect is refused. By hand.
    - `waves`: periods of a periodic effect that the stroke must hold. Larger: ripples on short strokes are lost;
      smaller: a wave that bends to any force that depends on the position is accepted. By hand.
    - `waves_beside`: the same beside another force, to whose remainder a wave and its overtone bend. By hand (commit
      e65a39a): beside a pendulum a wave had stood in for a load and for a spring.
    - `least_clusters`: clusters of 0.5 s below which a lead has no standard error. Larger: short recordings show
      nothing; smaller: two clusters decide. By hand.
    """

    lead: float = 3.0
    lead_each: float = 1.0
    least_share: float = 0.3
    enough_share: float = 0.8
    waves: float = 1.0
    waves_beside: float = 2.0
    least_clusters: int = 4


@dataclasses.dataclass(frozen=True)
class RivalRule:
    """Which names are reported as one class.

    **Attributes:**

    - `lead`: standard errors, over the clusters of all recordings, by which an acceptable candidate must trail the
      accepted one for the recordings to tell them apart. Larger: every name comes with a class; smaller: a wrong name
      is given alone. By hand.
    """

    lead: float = 2.5


@dataclasses.dataclass(frozen=True)
class VerdictRule:
    """When a model is adequate, and how little the named effects must leave for the verdict `named`.

    **Attributes:**

    - `adequate`: misfit per sample above the floor below which nothing significant is missing: 4 % more power than the
      floor, since a misfit of m is a power of 2 exp(2 m) - 1 times the floor. Larger: small effects are `adequate`;
      smaller: imperfections of the noise model are something missing. By hand.
    - `sure`: standard errors that chance may add to a misfit. Larger: short recordings are always adequate; smaller:
      chance in a short recording is something missing. By hand.
    - `remains`: times `adequate` above which something is reported to remain beside a name. Larger: a remainder is
      hidden; smaller: every name comes with one. By hand.
    - `one_exact`: share of the misfit that one effect whose equation is exact (a delay, a load) may leave. Larger:
      where an effect is none of the catalogue's, another one gets the name; smaller: right names become `unknown`. On
      the bank of seed 30 and three batches of `benchmarks.concealed`: right names left 5 % at most.
    - `several_exact`: the same for several such effects, which have more ways to stand in for another. As `one_exact`.
    - `one`: the same for one effect whose equation is an approximation (creep, hysteresis). As `one_exact`; right names
      left up to 30 %.
    - `several`: the same for several effects of which one is an approximation. As `one_exact`.
    - `unmeasured`: part of the applied force, both root mean square, from which the sentence of `adequate` states the
      unmeasured force that the model needs. Larger: physics that it hides is called noise; smaller: noise of a drive is
      called a force. By hand.
    """

    adequate: float = 0.01
    sure: float = 3.0
    remains: float = 2.0
    one_exact: float = 0.1
    several_exact: float = 0.04
    one: float = 0.3
    several: float = 0.1
    unmeasured: float = 0.02


@dataclasses.dataclass(frozen=True)
class CredibilityRule:
    """When a base fit predicts better than no model.

    **Attributes:**

    - `energy`: part of the energy of the errors of no model that must be explained. Larger: machines with much missing
      are not diagnosed; smaller: a reversed input is. By hand.
    - `lead`: standard errors by which the fit is likelier in most of the time, which is enough instead. As `energy`.
    - `loud`: power of a block, in units of the noise, from which its energy counts. Larger: quiet machines are not
      credible; smaller: under a coarse encoder noise outvotes the motion. By hand, on an encoder of 12 bit of
      `benchmarks.conditions`.
    - `least_clusters`: clusters below which there is no standard error. Larger: short recordings are not credible by
      their lead; smaller: two clusters decide. By hand.
    - `driven`: part by which the last model's typical error on held-out recordings must rise when its input is set to
      zero. Larger: machines that mostly swing or coast freely are not diagnosed; smaller: an input that has nothing to
      do with the motion is. By hand: without its input the demo's error is 45 times as large, and that of a sine beside
      an unrelated square wave is the same.
    """

    energy: float = 0.5
    lead: float = 3.0
    loud: float = 2.0
    least_clusters: int = 4
    driven: float = 0.1


@dataclasses.dataclass(frozen=True)
class TestabilityRule:
    """What the recordings must hold for an effect to be tested.

    **Attributes:**

    - `regime`: part of the time that a regime must take to count as visited. Larger: effects that a short passage shows
      are not tested; smaller: effects are tested that nothing shows. By hand.
    - `rest`: length of a rest that shows ageing contacts, s. As `regime`; by hand.
    - `warm_up`: length of the recordings that shows warm-up, s. As `regime`; by hand.
    - `warmer`: range of a measured temperature that shows warm-up by it, K. As `regime`; by hand.
    - `still`: standard deviation of a position over that of its noise up to which nothing moves, unless the next number
      says otherwise. Larger: small motions are refused; smaller: noise is taken for motion. By hand.
    - `drift`: standard deviation of means over 50 ms over that of means of noise alone, up to which nothing moves. As
      `still`.
    """

    regime: float = 0.002
    rest: float = 0.3
    warm_up: float = 10.0
    warmer: float = 1.0
    still: float = 1.2
    drift: float = 2.0


@dataclasses.dataclass(frozen=True)
class ResidualMapRule:
    """When a map of the missing force is reported.

    **Attributes:**

    - `lead`: standard errors by which the held-out misfit must fall; few clusters may hold all of it. Larger: maps that
      predict are not shown; smaller: maps of chance are. By hand.
    - `share`: part by which it must fall. As `lead`.
    """

    lead: float = 1.5
    share: float = 0.1


@dataclasses.dataclass(frozen=True)
class CeilingRule:
    """When a free force predicts better than the model.

    **Attributes:**

    - `lead`: standard errors by which it must lead on the held-out recordings, which no fit used. Larger: physics that
      no effect of the catalogue describes passes for noise; smaller: one machine in a thousand with nothing missing is
      not adequate. The usual level of three.
    """

    lead: float = 3.0


@dataclasses.dataclass(frozen=True)
class PlaceRule:
    """Which places of the map of the mismatch are reported.

    **Attributes:**

    - `significant`: p-value, over all bins or parts that were compared, below which a place is reported. Larger: places
      of chance; smaller: none in short recordings. The usual level.
    - `least_excess`: power over the floor below which nothing is reported, however sure. Larger: weak places are
      hidden; smaller: places that do not matter are reported. By hand, as all that follow.
    - `sharp`: share of the excess that one bin of another axis than the regime must hold to be reported. Larger: a spot
      is reported as a regime; smaller: a bin with half of the excess hides the other half.
    - `sharp_over_length`: times its share of the samples that this share must be, too. As `sharp`.
    - `everywhere`: ratio of the excesses of all regimes up to which none of them stands out. Larger: a place is
      reported as everywhere; smaller: one of three like regimes is singled out.
    - `beside`: part of the strongest regime's prominence from which another one is reported beside it. Larger: one of
      two like regimes is hidden; smaller: weak ones are reported.
    - `part_share`: share of the excess of the strongest bins that a part of another axis must hold. Larger: conditions
      are not reported; smaller: conditions that hold half of it are.
    - `part_contrast`: excess inside that part over the excess elsewhere. As `part_share`.
    - `largest_part`: part of the samples up to which it is a condition at all. Larger: "mostly everywhere" is reported;
      smaller: wide conditions are hidden.
    - `most_parts`: conditions that are reported, one inside the other.
    - `least_samples`: of a bin, or on either side of a condition, below which it is left out. Larger: short passages
      are on no map; smaller: bins of a few samples are compared, and cost all others significance.
    - `least_clusters`: clusters of a bin below which it has no standard error, and on either side of a condition below
      which it has no p-value. Larger: short recordings show no place; smaller: one cluster decides.
    - `only_share`: share of the excess from which "only" is said instead of "mostly". Larger: "only" is never said;
      smaller: it is said where a fifth lies elsewhere.
    - `only_rest`: excess elsewhere over the excess inside up to which "only" is said. As `only_share`.
    """

    significant: float = 0.05
    least_excess: float = 1.2
    sharp: float = 0.6
    sharp_over_length: float = 2.0
    everywhere: float = 3.0
    beside: float = 0.7
    part_share: float = 0.75
    part_contrast: float = 3.0
    largest_part: float = 0.8
    most_parts: int = 2
    least_samples: int = 200
    least_clusters: int = 3
    only_share: float = 0.9
    only_rest: float = 0.1


@dataclasses.dataclass(frozen=True)
class Rule:
    """The numbers that decide, by what they decide.

    **Attributes:** `floor` (what enters the comparisons), `accept` (a candidate), `rivals` (names of one class),
    `limits` (verdicts), `credible` (the base fit), `testable` (what an effect needs), `residual` (a map of the missing
    force), `ceiling` (a free force), `place` (where the mismatch is).
    """

    floor: FloorRule = FloorRule()
    accept: AcceptanceRule = AcceptanceRule()
    rivals: RivalRule = RivalRule()
    limits: VerdictRule = VerdictRule()
    credible: CredibilityRule = CredibilityRule()
    testable: TestabilityRule = TestabilityRule()
    residual: ResidualMapRule = ResidualMapRule()
    ceiling: CeilingRule = CeilingRule()
    place: PlaceRule = PlaceRule()

    def numbers(self) -> dict[str, float]:
        """Each number by its name, as in `accept.least_share`."""
        return {
            f"{group}.{name}": value
            for group, own in dataclasses.asdict(self).items()
            for name, value in own.items()
        }

    def changed(self, numbers: dict[str, float]) -> "Rule":
        """The same rule with other `numbers`, by their names. Raises `KeyError` for a name that it does not have."""
        rule = self
        for path, value in numbers.items():
            group, _, name = path.partition(".")
            if path not in self.numbers():
                raise KeyError(path)
            own = getattr(rule, group)
            kept = round(value) if isinstance(getattr(own, name), int) else float(value)
            rule = dataclasses.replace(rule, **{group: dataclasses.replace(own, **{name: kept})})
        return rule

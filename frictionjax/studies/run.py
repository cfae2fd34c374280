"""`run_study`: a function over a design of cases and seeds, on any executor, resumed from what is on disk."""

import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from pathlib import Path
from typing import Any

import equinox as eqx

from frictionjax.core import InputError, Progress, public_verb, reporting
from frictionjax.core.display import AbstractDisplayed, Display, records_grid
from frictionjax.core.frames import records, to_dataframe


class Design(eqx.Module):
    """What a study runs: `function(seed=seed, **case)` for every case and every seed.

    The seeds are the same for all cases, so that cases are compared on the same random numbers.

    **Attributes:**

    - `function`: takes the entries of a case and an integer `seed` as keywords, and returns a mapping of names to
        numbers. For a pool of processes it must stand at the top of a module.
    - `cases`: mappings of names to numbers, texts, booleans or lists of these, one for each setting; see `grid`.
    - `seeds`: how many times each case is run, with the seeds `seed`, `seed + 1`, ...
    - `seed`: the first seed.
    """

    function: Callable[..., Mapping[str, Any]] = eqx.field(static=True)
    cases: tuple[Mapping[str, Any], ...] = eqx.field(static=True, converter=tuple, default=({},))
    seeds: int = eqx.field(static=True, default=1)
    seed: int = eqx.field(static=True, default=0)


class Study(AbstractDisplayed):
    """The results of a study.

    **Attributes:**

    - `runs`: one mapping for each finished run, in the order of the design: the entries of its case, `seed`, and the
        numbers that the function returned.
    - `failures`: one mapping for each run that raised: its case, `seed`, and `error`, the sentence.
    - `resumed`: how many of `runs` were read from disk instead of being run.
    """

    runs: tuple[Mapping[str, Any], ...] = eqx.field(static=True)
    failures: tuple[Mapping[str, Any], ...] = eqx.field(static=True)
    resumed: int = eqx.field(static=True)
    _names: tuple[str, ...] = eqx.field(static=True)

    def summary(self) -> list[dict[str, Any]]:
        """One row for each case: its entries, `runs`, and of each number the mean, `_std` and `_stderr` over seeds.

        Values that are not finite are left out of them; what cannot be computed is None.
        """
        groups: dict[str, list[Mapping[str, Any]]] = {}
        for run in self.runs:
            groups.setdefault(_text({name: run[name] for name in self._names if name in run}), []).append(run)
        rows = []
        for text, runs in groups.items():
            row = {**json.loads(text), "runs": len(runs)}
            for name in dict.fromkeys(name for run in runs for name in run):
                if name in self._names or name == "seed":
                    continue
                values = [run[name] for run in runs if name in run and math.isfinite(run[name])]
                n = len(values)
                mean = math.fsum(values) / n if n else None
                spread = (
                    math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (n - 1))
                    if mean is not None and n > 1
                    else None
                )
                row[name] = mean
                row[f"{name}_std"] = spread
                row[f"{name}_stderr"] = spread / math.sqrt(n) if spread is not None else None
            rows.append(row)
        return rows

    @property
    def settings(self) -> tuple[str, ...]:
        """The names of the entries of a case."""
        return self._names

    def _display(self) -> Display:
        failed = (f"{len(self.failures)} runs failed: {self.failures[0]['error']}",) if self.failures else ()
        title = f"Study of {len(self.runs)} runs, {self.resumed} of them read from disk"
        return Display(title, failed, (records_grid(self.summary()),))

    def plot(self, **how: Any) -> Any:
        """Draw the mean of each number, with its standard error, over the first entry of the cases that varies:
        `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each run."""
        return to_dataframe(records(self.runs))


def grid(**axes: Iterable[Any]) -> tuple[dict[str, Any], ...]:
    """Every combination of the values of `axes`, the last axis fastest: the cases of a full factorial design."""
    return tuple(
        dict(zip(axes, values, strict=True))
        for values in itertools.product(*(tuple(axis) for axis in axes.values()))
    )


def run_study(
    design: Design,
    executor: Executor | None = None,
    *,
    out: str | Path | None = None,
    progress: Progress | bool = True,
) -> Study:
    """Run every case of `design` with every seed.

    A run that raises is kept as a failure, and the others go on. With `out`, each finished run is one line of that
    file as soon as it is there; a study that was stopped, or whose design has grown, runs only what is missing.
    Failures are not written, and are tried again.

    **Arguments:**

    - `design`: the `Design`.
    - `executor`: any executor of `concurrent.futures`; by default the runs follow each other in this process. JAX does
        not survive a fork: make a pool of processes with the "spawn" context.
    - `out`: file of finished runs, JSON lines; made where it is not there.
    - `progress`: called as runs finish; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:** the `Study`.

    **Raises:** `InputError` when a case cannot be written as JSON, has an entry `seed`, or a line of `out` cannot be
        read; whatever the function raised, when every run fails.
    """
    plan = _plan(design)
    done = _finished(Path(out)) if out is not None else {}
    results = {key: done[key] for key in plan if key in done}
    resumed, failures = len(results), {}
    waiting = [key for key in plan if key not in results]
    finished = _in_turn(design, plan, waiting) if executor is None else _on(executor, design, plan, waiting)
    with reporting(progress) as report:
        for count, (key, result, error) in enumerate(finished, start=1):
            if error is not None:
                failures[key] = error
            else:
                results[key] = result
                if out is not None:
                    _append(Path(out), key, result)
            report("runs", (resumed + count) / len(plan))
    if failures and not results:
        raise next(iter(failures.values()))
    names = tuple(dict.fromkeys(name for case in design.cases for name in case))
    return Study(
        runs=tuple(
            {**case, "seed": seed, **results[key]} for key, (case, seed) in plan.items() if key in results
        ),
        failures=tuple(
            {**case, "seed": seed, "error": f"{type(failures[key]).__name__}: {failures[key]}"}
            for key, (case, seed) in plan.items()
            if key in failures
        ),
        resumed=resumed,
        _names=names,
    )


Plan = dict[str, tuple[Mapping[str, Any], int]]
"""Every run as (case, seed), by the text that stands for it on disk."""

Outcome = tuple[str, dict[str, float], Exception | None]
"""A run's text, its numbers, and what it raised instead."""


def _plan(design: Design) -> Plan:
    """Every run as (case, seed), by the text that stands for it on disk."""
    function = f"{design.function.__module__}.{design.function.__qualname__}"
    plan = {}
    for i, case in enumerate(design.cases):
        if "seed" in case:
            raise InputError(f"case {i} has an entry `seed`", cure="Give `seeds` and `seed` of the design.")
        for seed in range(design.seed, design.seed + design.seeds):
            try:
                key = _text({"function": function, "case": dict(case), "seed": seed})
            except TypeError as error:
                raise InputError(
                    f"case {i} cannot be written as JSON: {error}",
                    cure="Use numbers, texts, booleans and lists, and make arrays inside the function.",
                ) from error
            plan[key] = (case, seed)
    return plan


def _call(function: Callable[..., Mapping[str, Any]], case: Mapping[str, Any], seed: int) -> dict[str, float]:
    return {name: float(value) for name, value in function(seed=seed, **case).items()}


def _in_turn(design: Design, plan: Plan, waiting: list[str]) -> Iterator[Outcome]:
    for key in waiting:
        try:
            result, error = _call(design.function, *plan[key]), None
        except Exception as raised:  # a failed run is a result: it is reported with the study
            result, error = {}, raised
        yield key, result, error


def _on(executor: Executor, design: Design, plan: Plan, waiting: list[str]) -> Iterator[Outcome]:
    futures = {executor.submit(_call, design.function, *plan[key]): key for key in waiting}
    try:
        for future in as_completed(futures):
            error = future.exception()
            if error is not None and not isinstance(error, Exception):
                raise error
            yield futures[future], {} if error else future.result(), error
    finally:
        for future in futures:
            future.cancel()


def _text(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True)


def _append(path: Path, key: str, result: dict[str, float]) -> None:
    finite = {name: value if math.isfinite(value) else None for name, value in result.items()}
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps({"run": json.loads(key), "result": finite}, sort_keys=True) + "\n")


def _finished(path: Path) -> dict[str, dict[str, float]]:
    """The finished runs in the file `path`; a last line that was cut off as it was written is removed."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        return {}
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    found = {}
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            entry = json.loads(line)
            result = {
                name: math.nan if value is None else float(value) for name, value in entry["result"].items()
            }
            found[_text(entry["run"])] = result
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                "the line is not a finished run",
                file=path,
                place=f"line {number}",
                cure="Remove the line, or give another `out`.",
            ) from error
    return found

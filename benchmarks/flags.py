"""What each of the XLA flags of `configure_jax()` does: `python -m benchmarks flags`.

Flags are read once in a process, so every combination is measured in a process of its own.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.timing import row
from frictionjax.core.setup import LOOPS, older_fusion

WHOLE, MERGE, FLAT = LOOPS
COMBINATIONS = {
    "none of the three": (),
    "whole loops": (WHOLE,),
    "whole loops, merged outputs": (WHOLE, MERGE),
    "all three": (WHOLE, MERGE, FLAT),
}


def inside(samples: int) -> dict[str, float]:
    """Nanoseconds a step of one record, of a batch of 64 on one device, of a Jacobian in 7 and of a reverse-mode
    gradient of one record, the number of fused loops in a step, and seconds of compilation; under the flags of this
    process."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    from benchmarks.problem import SAMPLE_RATE, STAGE, drive_of, force, many
    from benchmarks.timing import first_call, medians
    from frictionjax import simulate

    push, logs = jnp.asarray(force(samples)), jnp.zeros(7)

    def position(logs, push):
        return simulate(drive_of(jnp.exp(logs) * STAGE), push, SAMPLE_RATE, substeps=1).x

    def misfit(logs, push):
        return jnp.sum(position(logs, push) ** 2)

    def batch(table, push):
        return jax.vmap(lambda p: simulate(drive_of(p), push, SAMPLE_RATE, substeps=1).x[-1])(table)

    few, table = push[: samples // 4], jnp.asarray(many(64))
    start = time.perf_counter()
    programs = {
        "one record": jax.jit(position).lower(logs, push).compile(),
        "batch of 64": jax.jit(batch).lower(table, few).compile(),
        "Jacobian in 7": jax.jit(jax.jacfwd(position)).lower(logs, push).compile(),
        "reverse mode": jax.jit(jax.grad(misfit)).lower(logs, push).compile(),
    }
    seconds = time.perf_counter() - start
    runs = {name: lambda f=f: f(logs, push) for name, f in programs.items() if name != "batch of 64"}
    runs["batch of 64"] = lambda: programs["batch of 64"](table, few)
    for run in runs.values():
        first_call(run)
    steps = dict.fromkeys(runs, samples) | {"batch of 64": 64 * few.size}
    found = {name: 1e9 * s / steps[name] for name, s in medians(runs, repeats=3).items()}
    fused = float(programs["batch of 64"].as_text().count(" fusion("))
    return found | {"fused loops": fused, "compilation": seconds}


UNITS = {"fused loops": "1", "compilation": "s"}
"""Of what is measured; of all else ns a step."""


def _measured(samples: int, names: tuple[str, ...], width: int, *more: str) -> dict[str, float]:
    extra = ",".join(f"{name}={LOOPS[name]}" for name in names)
    flags = " ".join((f"--xla_cpu_prefer_vector_width={width}", *more))
    flags += f" --xla_backend_extra_options={extra}" if extra else ""
    code = f"import json; from benchmarks.flags import inside; print(json.dumps(inside({samples})))"
    repository = Path(__file__).parents[1]
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": str(repository)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"the flags {flags} could not be measured: {done.stderr.strip()[-500:]}")
    return json.loads(done.stdout.splitlines()[-1])


def measure(*, small: bool = False) -> list[dict]:
    """All rows; `small`: short records."""
    samples = 400 if small else 8000
    cases: list[tuple] = [(name, names, 512) for name, names in COMBINATIONS.items()]
    cases.append(("all three, vectors of 256 bits", COMBINATIONS["all three"], 256))
    if older_fusion():
        cases.append(("all three, older fusion", COMBINATIONS["all three"], 512, *older_fusion()))
    return [
        row(f"{label}: {what}", value, UNITS.get(what, "ns a step"))
        for label, *flags in cases
        for what, value in _measured(samples, *flags).items()
    ]

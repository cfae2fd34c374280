"""What compilation costs a diagnosis: `python -m benchmarks compile_time_diagnose`.

The embedded case of `frictionjax demo`, in this process, nothing kept from earlier runs; `tests/house/test_traces.py`
holds that another case of the same shapes compiles nothing.
"""

import tempfile
from pathlib import Path

from benchmarks.timing import all_compiled_anew, first_call, row
from frictionjax import diagnose, load_case
from frictionjax.core.compile_time import CompileClock
from frictionjax.demo import write_demo_case


def measure(*, small: bool = False) -> list[dict]:
    """The rows; there is no smaller size than this case."""
    with tempfile.TemporaryDirectory() as folder, all_compiled_anew():
        case = load_case(write_demo_case(Path(folder) / "case"))
        clock = CompileClock()
        first = first_call(lambda: diagnose(case).verdict)
        compiled = clock.seconds
        second = first_call(lambda: diagnose(case).verdict)
    return [
        row("diagnose, embedded case: first call", first, "s"),
        row("diagnose, embedded case: of that compilation (both threads)", compiled, "s"),
        row("diagnose, embedded case: once more", second, "s"),
    ]

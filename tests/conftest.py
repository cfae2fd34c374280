"""The strict test session: float64, no silent promotion of types or ranks, two CPU devices, warnings are errors."""

import gc
import os
import random
from pathlib import Path

os.environ["JAX_ENABLE_X64"] = "1"
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"
os.environ["MPLBACKEND"] = "Agg"
# Even the smallest program is kept: to read it takes a third or less of its compilation, to write it a sixth at most.
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"

import pytest

TYPED = (
    *("core", "excitation", "recordings", "frequency", "physics", "simulation", "estimation", "information"),
    *("exchange", "diagnosis", "arm", "studies", "report", "paper", "demo", "cli"),
)
"""Packages whose annotations, shapes included, are checked at every call with `--types`: all that have functions. Types
that `cli` names for the type checker alone, as they load late, are not resolved, and not checked. A test that hands
over a stand-in, or what must be refused, is marked `untyped`."""

TOGETHER = [
    (
        "tests/diagnosis/selection/test_review.py",
        "tests/diagnosis/selection/test_answers.py",
        "tests/diagnosis/selection/test_exchange.py",
        "tests/diagnosis/selection/test_moved.py",
    )
]
"""Files whose tests start from the same fits: one worker runs them all, and fits once."""

LONG = (
    "tests/report/test_stopped.py",
    "tests/benchmarks/test_hostile.py",
    "tests/house/test_traces.py",
    *TOGETHER[0],
    "tests/diagnosis/test_pipeline.py",
    "tests/test_notebooks.py",
    "tests/estimation/descent/test_robust_fit.py",
    "tests/estimation/test_fit.py",
    "tests/frequency/test_bla.py",
)
"""Files that take longest, begun first: at the end no worker waits long for another. Before them, those that copy their
process: a copy of one that has compiled much takes four times as long."""

COMPILED_PLAINLY = (
    "tests/benchmarks/test_benchmarks.py",
    "tests/benchmarks/test_concealed.py",
    "tests/diagnosis/evidence",
    "tests/diagnosis/findings",
    "tests/diagnosis/intake",
    "tests/diagnosis/test_motion.py",
    "tests/estimation/objective",
    "tests/estimation/test_parameters.py",
    "tests/excitation",
    "tests/house/test_traces.py",
    "tests/paper",
    "tests/physics",
    "tests/simulation",
    "tests/studies/test_estimators.py",
    "tests/studies/test_level_sweep.py",
    "tests/studies/test_machine_tasks.py",
    "tests/studies/test_run.py",
    "tests/studies/test_store.py",
    "tests/test_study_command.py",
)
"""Files and folders whose programs run for a moment and take long to compile: they are compiled with few optimisations,
which takes half of the time. With `--slow` they, too, are compiled as for a user."""


COUNTED = "tests/house/test_traces.py"
"""Where traces are counted: a whole program that is found on the disk is not traced."""


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="also run the tests marked slow")
    parser.addoption(
        "--types", action="store_true", help="check types and shapes at every call of the package"
    )


def pytest_configure(config):
    if config.getoption("--types"):
        # Before the package is imported: what it imports from now on is checked.
        from jaxtyping import install_import_hook

        install_import_hook([f"frictionjax.{package}" for package in TYPED], "helpers_types.checked")
        # Of a list the checker looks at one item by chance, also where Hypothesis draws examples.
        config.addinivalue_line(
            "filterwarnings",
            "ignore:Do not use the `random` module:hypothesis.errors.HypothesisDeprecationWarning",
        )
    _set_up()


def _set_up():
    """JAX as the program has it, but strict, and with its compiled programs in the checkout."""
    import hypothesis
    import jax

    import frictionjax

    # No test is timed: a busy machine makes any example slow.
    hypothesis.settings.register_profile("untimed", deadline=None)
    hypothesis.settings.load_profile("untimed")
    # XLA reads its flags when JAX first computes.
    frictionjax.configure_jax()
    # Compiled programs are kept in the checkout, or where `.ci/run` says, never in the user's cache, for the other
    # files, the other workers and the next run: most of the tests' time is compilation. Programs that the tests start
    # keep theirs there, too. What counts traces counts them all the same: a program that is found there is traced and
    # asked for like any other.
    here = (
        os.environ.get("FRICTIONJAX_TEST_PROGRAMS")
        or Path(__file__).parents[1] / ".pytest_cache" / "compiled"
    )
    frictionjax.core.keep_compiled(Path(here))
    os.environ["JAX_COMPILATION_CACHE_DIR"] = jax.config.jax_compilation_cache_dir or ""
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")


def pytest_runtest_setup(item):
    """The same items of lists are checked in every run."""
    if item.config.getoption("--types"):
        random.seed(0)


def pytest_xdist_make_scheduler(config, log):
    """A file to a worker, as modules share what is costly; files that belong together go to one."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Together(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return next((files[0] for files in TOGETHER if file in files), file)

    return Together(config, log)


def pytest_collection_modifyitems(config, items):
    order = {file: place for place, file in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.nodeid.split("::")[0], len(order)))
    left_out = {}
    if not config.getoption("--slow"):
        left_out["slow"] = pytest.mark.skip(reason="slow: run with --slow")
    if config.getoption("--types"):
        left_out["untyped"] = pytest.mark.skip(reason="untyped: not run with --types")
    for item in items:
        for word, skip in left_out.items():
            if word in item.keywords:
                item.add_marker(skip)


def pytest_collection_finish(session):
    """What is imported by now lives to the end. Python searches all of it for garbage at every so many new objects, of
    which a trace makes many: a tenth of the tests' time. Searched is what a test makes, and less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 20)


@pytest.fixture(scope="module", autouse=True)
def _compiled_plainly(request):
    """Few optimisations of what the files of COMPILED_PLAINLY compile, and all of them elsewhere and with `--slow`; and
    no program of an earlier run where traces are counted."""
    import jax

    from frictionjax.core.programs import forget_programs

    here = request.path.relative_to(request.config.rootpath).as_posix()
    plainly = here.startswith(COMPILED_PLAINLY) and not request.config.getoption("--slow")
    jax.config.update("jax_disable_most_optimizations", plainly)
    counted = here == COUNTED
    jax.config.update("jax_enable_compilation_cache", not counted)
    if counted:
        forget_programs()


@pytest.fixture
def getkey():
    """Returns fresh random keys from one fixed seed."""
    import jax

    key = jax.random.key(20020301)

    def next_key():
        nonlocal key
        key, sub = jax.random.split(key)
        return sub

    return next_key

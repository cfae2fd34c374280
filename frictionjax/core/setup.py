"""`configure_jax`: float64, one device per core, and loops compiled to one piece of machine code each;
`keep_compiled`: a cache of compiled programs for later processes; `keep_memory`: freed memory stays with the process.
"""

import ctypes
import functools
import hashlib
import os
import platform
import socket
import subprocess
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import jax
from platformdirs import user_cache_path

from frictionjax.core.errors import FrictionjaxWarning
from frictionjax.core.tidy import tidy

LOOPS = {
    # Compiles a loop over small arrays as a whole. By default each of its operations is a call of its own, which costs
    # a scalar simulation ten times its arithmetic.
    "xla_cpu_small_while_loop_byte_threshold": "1000000",
    # Computes outputs of the same inputs together instead of each on its own.
    "xla_cpu_use_multi_output_fusion": "true",
    # Without this the two options above copy every stored array as a whole at each step.
    "xla_cpu_flatten_after_fusion": "true",
}
"""Options of XLA's CPU compiler, by name; `python -m benchmarks flags` prints what each does."""
_WIDTH = "--xla_cpu_prefer_vector_width=512"
_EXTRA = "--xla_backend_extra_options="
_OLDER_FUSION = "--xla_cpu_use_fusion_emitters"
_LAST_WITH_OLDER_FUSION = (0, 10)  # of jaxlib: later ones end the process at a flag unknown to them


def _with_our_flags(flags: str) -> str:
    """`flags` (the value of XLA_FLAGS) with our options added; options that the user has set stay."""
    words = flags.split()
    if not any(word.startswith("--xla_cpu_prefer_vector_width") for word in words):
        words.append(_WIDTH)
    if not any(word.startswith(_OLDER_FUSION) for word in words):
        words += older_fusion()
    theirs = next((word for word in words if word.startswith(_EXTRA)), _EXTRA)
    options = [option for option in theirs.removeprefix(_EXTRA).split(",") if option]
    named = {option.split("=")[0] for option in options}
    options += [f"{name}={value}" for name, value in LOOPS.items() if name not in named]
    return " ".join([word for word in words if not word.startswith(_EXTRA)] + [_EXTRA + ",".join(options)])


def older_fusion() -> list[str]:
    """The flag for XLA's older way to compile what is fused, which takes four fifths of the time of the newer one and
    makes what is as fast (`python -m benchmarks flags`); none where jaxlib has only the newer one."""
    jaxlib = tuple(int(part) for part in version("jaxlib").split(".")[:2])
    return [f"{_OLDER_FUSION}=false"] if jaxlib <= _LAST_WITH_OLDER_FUSION else []


def configure_jax(*, cpu_devices: int | None = None) -> None:
    """Set JAX up for simulations, once, before it computes anything: call it right after the imports.

    Switches float64 on; makes every processor core a JAX device, over which batches are spread; and asks XLA, through
    the environment variable XLA_FLAGS, to compile small loops as one piece. Simulations run several times faster with
    it, and results change by rounding errors only. Options already in XLA_FLAGS stay. The whole process is affected,
    which is why the library never does this unasked; the program `frictionjax` does.

    **Arguments:**

    - `cpu_devices`: number of CPU devices; None: as many as cores, or as XLA_FLAGS says.

    **Raises:**

    `ValueError` when `cpu_devices` is below 1. Where JAX has computed something already, a `FrictionjaxWarning` says
    that simulations stay slow; float64 is switched on all the same.
    """
    if cpu_devices is not None and cpu_devices < 1:
        raise ValueError(f"`cpu_devices` is {cpu_devices}; at least one is needed. None takes every core.")
    jax.config.update("jax_enable_x64", True)
    before = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = flags = _with_our_flags(before)
    if cpu_devices is None:
        if "xla_force_host_platform_device_count" in flags:
            return
        cpu_devices = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    try:
        # This raises once there are devices: the one public sign that XLA_FLAGS has been read.
        jax.config.update("jax_num_cpu_devices", cpu_devices or 1)
    except RuntimeError:
        if flags != before:
            warnings.warn(
                "JAX has computed something before `configure_jax()`: simulations stay slow in this process. "
                "Call it right after `import frictionjax`, in a fresh process.",
                FrictionjaxWarning,
                stacklevel=2,
            )


_CPUINFO = Path("/proc/cpuinfo")
# Lines of it that name the model and its instructions, on x86 and on Arm; the others are clock rates and core numbers.
_CPU_FIELDS = (
    "vendor",
    "cpu family",
    "model",
    "flags",
    "CPU implementer",
    "CPU variant",
    "CPU part",
    "Features",
)


def processor() -> str:
    """The model and the instructions of this processor, in the words of the system."""
    if _CPUINFO.exists():
        lines = _CPUINFO.read_text(errors="replace").split("\n\n")[0].splitlines()
        found = [line for line in lines if line.startswith(_CPU_FIELDS)]
        if found:
            return "\n".join(found)
    if platform.system() == "Darwin":
        asked = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout
    return platform.processor()


_OTHERS_WRITE = 0o022  # permission bits of the group and of everybody


def _platform_folder() -> str:
    """The name of a folder for what this jaxlib compiles for this processor.

    XLA compiles for the processor at hand, and a program of one with more instructions crashes the process that runs
    it on another: several machines may share one home.
    """
    digest = hashlib.sha256(processor().encode()).hexdigest()[:12]
    return f"{platform.machine()}-{digest}-jaxlib-{version('jaxlib')}"


def _is_own(folder: Path) -> bool:
    """Whether the folder belongs to this user, and more can be added; it is closed to what others would add."""
    if not os.access(folder, os.W_OK):
        return False
    if not hasattr(os, "getuid"):
        return True
    if folder.stat().st_uid != os.getuid():
        return False
    if folder.stat().st_mode & _OTHERS_WRITE:
        try:
            folder.chmod(0o700)
        except OSError:  # a file system without permissions
            return False
    return True


def keep_compiled(folder: Path | None = None) -> None:
    """Keep what JAX compiles in `folder` (default: the user's cache), so that later processes with the same shapes
    do not compile again.

    Each model of processor and each version of jaxlib has a folder of its own in there. A cache that is set already
    stays (`JAX_COMPILATION_CACHE_DIR` or JAX's own setting), and where the folder cannot be written or belongs to
    another user, whose programs are not run, nothing is kept. What was cut short when a process was killed is removed,
    and beyond 2 GB the programs that were not used for longest. Like `configure_jax` it affects the whole process; the
    program `frictionjax` calls it.
    """
    if getattr(jax.config, "jax_compilation_cache_dir", None) is not None:
        return
    folder = user_cache_path("frictionjax") / "compiled" if folder is None else folder
    folder = folder / _platform_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return
    if _is_own(folder):
        tidy(folder.parent)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def programs_folder() -> Path | None:
    """Where whole programs are kept (`core/programs.py`): beside what JAX keeps; None where it keeps nothing (an empty
    name is none), where that is no folder of this machine, or where another user could have put programs."""
    kept = getattr(jax.config, "jax_compilation_cache_dir", None)
    if not kept or "://" in kept or not getattr(jax.config, "jax_enable_compilation_cache", True):
        return None
    folder = Path(kept) / "frictionjax"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if _is_own(folder) else None


class JaxSettings(NamedTuple):
    """What a process that works for another must have in common with it, so that its numbers are the same.

    **Attributes:**

    - `process`: host and number of the process that they are those of.
    - `x64`: whether JAX computes in float64.
    - `plainly`: whether it compiles with few optimisations.
    - `precision`: of matrix products, as JAX has it.
    - `flags`: XLA_FLAGS.
    - `platform`: processor and jaxlib, for which programs are compiled.
    - `compiled`: where compiled programs are kept; None: nowhere.
    """

    process: tuple[str, int]
    x64: bool
    plainly: bool
    precision: str | None
    flags: str
    platform: str
    compiled: str | None


def jax_settings() -> JaxSettings:
    """Those of this process."""
    return JaxSettings(
        _this_process(),
        bool(getattr(jax.config, "jax_enable_x64", False)),
        bool(getattr(jax.config, "jax_disable_most_optimizations", False)),
        getattr(jax.config, "jax_default_matmul_precision", None),
        os.environ.get("XLA_FLAGS", ""),
        _platform_folder(),
        getattr(jax.config, "jax_compilation_cache_dir", None),
    )


def work_as(settings: JaxSettings) -> None:
    """Set JAX up in a process that works for another, as the `settings` of that one are, before it computes anything.

    Compiled programs are kept, and where both have one kind of processor, shared: otherwise every process would compile
    them again. In the process that the settings are those of, nothing happens.
    """
    if settings.process != _this_process():
        _work_as(settings)


@functools.lru_cache(maxsize=1)
def _work_as(settings: JaxSettings) -> None:
    os.environ["XLA_FLAGS"] = settings.flags
    jax.config.update("jax_enable_x64", settings.x64)
    jax.config.update("jax_disable_most_optimizations", settings.plainly)
    jax.config.update("jax_default_matmul_precision", settings.precision)
    if settings.compiled is not None and settings.platform == _platform_folder():
        jax.config.update("jax_compilation_cache_dir", settings.compiled)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    keep_compiled()


def _this_process() -> tuple[str, int]:
    return socket.gethostname(), os.getpid()


# Options of glibc's `mallopt` by number, and their values: no memory is returned to the system, and all but the largest
# arrays come from heaps. One heap for all threads would need less memory, but threads that compile would wait for it.
_MALLOC = {"M_TRIM_THRESHOLD": (-1, 2**31 - 1), "M_MMAP_THRESHOLD": (-3, 2**30)}


def keep_memory() -> None:
    """Keep the memory of freed arrays in the process, for the next arrays.

    The C library of Linux gives the pages of large arrays back to the system and asks for them again, thousands of
    times in a diagnosis, and the system clears them each time. Like `configure_jax` it affects the whole process; the
    program `frictionjax` calls it. With another C library it does nothing.
    """
    if platform.libc_ver()[0] != "glibc":
        return
    library = ctypes.CDLL(None)
    for option, value in _MALLOC.values():
        library.mallopt(option, value)

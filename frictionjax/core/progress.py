"""How a long verb reports its progress, whoever listens."""

from typing import Protocol, runtime_checkable


@runtime_checkable
class Progress(Protocol):
    """Called by the verbs as work goes on: `progress(stage, fraction)` with `fraction` of the whole in [0, 1]."""

    def __call__(self, stage: str, fraction: float) -> None: ...


def silent(stage: str, fraction: float) -> None:
    """The `Progress` that reports nothing: `stage` and `fraction` are ignored."""

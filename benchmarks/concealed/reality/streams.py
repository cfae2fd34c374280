"""Random streams: one of its own for each purpose, so that nothing shifts when an effect draws more numbers."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, *labels: str) -> np.random.Generator:
    """The random stream of a seed for the purpose that `labels` name."""
    return np.random.default_rng([seed, *(zlib.crc32(label.encode()) for label in labels)])

"""How alike the effects are before these recordings, with all base parameters free: no rival, but what predicts errors.

Cosines between the effects' columns after the base model's own columns are projected out.
"""

from __future__ import annotations

import numpy as np

from benchmarks.concealed.rivals.ground import Ground


def geometry(ground: Ground) -> dict:
    """Names and the matrix of absolute cosines; each effect by the column that the residual likes best."""
    weighing = ground.present.weighings[0]
    weight, base = np.asarray(weighing.weight).ravel(), np.asarray(weighing.base)
    inverse = np.linalg.pinv(weighing.gram, hermitian=True)
    best: dict[str, tuple[float, np.ndarray]] = {}
    for column in ground.columns:
        for values in column.values.reshape(column.values.shape[0], -1):
            cross = base @ values
            own = float((weight * values) @ values - cross @ inverse @ cross)
            size = float((weight * values) @ values)
            if own > 1e-9 * size:
                e = np.nan_to_num(np.asarray(ground.present.e)).ravel()
                right = float((weight * values) @ e - weighing.right @ inverse @ cross)
                gain = right**2 / own
                if column.effect not in best or gain > best[column.effect][0]:
                    best[column.effect] = gain, values
    names = sorted(best)
    flat = np.stack([best[name][1] for name in names]) if names else np.zeros((0, weight.size))
    cross = flat @ base.T
    gram = (flat * weight) @ flat.T - cross @ inverse @ cross.T
    length = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    cosines = np.clip(np.abs(gram / np.outer(length, length)), 0.0, 1.0)
    return {"names": names, "cosines": np.round(cosines, 3).tolist()}

"""Draw README's picture from the result of `frictionjax demo --out out/demo`.

python benchmarks/hero.py out/demo docs/pictures/demo.png
"""

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

BASE, EXTENDED = "#d55e00", "#0072b2"


def main(result: Path, picture: Path) -> None:
    """Held-out presliding recording: hysteresis, prediction error before and after, and where the mismatch is."""
    verdict = json.loads((result / "verdict.json").read_text())
    data = np.genfromtxt(result / "fit" / "holdout_stick.csv", delimiter=",", names=True)
    errors = verdict["fit"]["holdout_stick"]
    bins = [b for b in verdict["mismatch"] if b["axis"] == "regime"]
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11, 3.2), constrained_layout=True)
    part = (data["t"] > 0.1) & (data["t"] < 4.0)
    for name, colour, label in (
        ("free_base", BASE, "LuGre alone"),
        ("free_extended", EXTENDED, "with what was named"),
    ):
        left.plot(1e3 * data[name][part], data["u"][part], color=colour, lw=1.0, label=label)
    left.plot(1e3 * data["x"][part], data["u"][part], color="0.15", lw=0.8, label="measured")
    left.set(xlabel="position (mrad), free run", ylabel="input (V)", title="presliding, a held-out recording")
    left.legend(fontsize=7, frameon=False)
    for name, colour, kind in (
        ("predicted_base", BASE, "base"),
        ("predicted_extended", EXTENDED, "extended"),
    ):
        rmse = 1e6 * errors[kind]["prediction_rmse"]
        middle.plot(
            data["t"], 1e6 * (data["x"] - data[name]), color=colour, lw=0.8, label=f"{rmse:.0f} µrad rms"
        )
    middle.set(xlabel="time (s)", ylabel="error 0.1 s ahead (µrad)", title="prediction error, same recording")
    middle.legend(fontsize=7, frameon=False)
    place = np.arange(len(bins))
    right.barh(place, [b["excess"] for b in bins], color=BASE, height=0.4)
    right.barh(place + 0.4, [b["excess_extended"] for b in bins], color=EXTENDED, height=0.4)
    right.set(xscale="log", xlabel="innovation power over the noise floor", title="where the mismatch is")
    right.set_yticks(place + 0.2, [b["bin"].split(" (")[0] for b in bins], fontsize=8)
    right.axvline(1.0, color="0.5", lw=0.8)
    for axis in (left, middle, right):
        axis.spines[["top", "right"]].set_visible(False)
        axis.title.set_fontsize(9)
    figure.savefig(picture, dpi=130)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

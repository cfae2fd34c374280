"""One case after the seal is broken: what it conceals, what was said of it, and how the two compare."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.diagnosis import size_error


@dataclass(frozen=True)
class Answer:
    """`truth` (as sealed), `verdict` (verdict.json), `rivals` (what they said, empty if not asked) and `witness` (what
    the simulator knows, see `witness.py`, empty if not asked) of the case `name`."""

    name: str
    truth: dict
    verdict: dict
    rivals: dict = field(default_factory=dict)
    witness: dict = field(default_factory=dict)

    @property
    def named(self) -> list[str]:
        """Names given, strongest first."""
        return [missing["effect"] for missing in self.verdict["missing"]]

    @property
    def stratum(self) -> str:
        """nothing, one, two, confusable or outside."""
        return self.truth["stratum"]

    @property
    def right(self) -> bool:
        """The first name is one of what is concealed."""
        return bool(self.named) and self.named[0] in self.truth["missing"]

    @property
    def right_within_class(self) -> bool:
        """The first name, or one that it is said not to be distinguished from, is one of what is concealed."""
        return bool(self.named) and bool(
            set(self.verdict["missing"][0]["class"]) & set(self.truth["missing"])
        )

    @property
    def outcome(self) -> str:
        """named, class, wrong, unknown or adequate (failed: the case was refused)."""
        if not self.named:
            return self.verdict["verdict"]
        return "named" if self.right else "class" if self.right_within_class else "wrong"

    @property
    def size_error(self) -> tuple[float, float] | None:
        """Relative error of the size and the same in standard errors, where the effect's size means the same in the
        simulator and in the library; else None."""
        missing = self.verdict["missing"]
        line = {
            "missing": self.truth["missing"],
            "named": self.named,
            "classes": [m["class"] for m in missing],
            "parameters": [
                {
                    name: [
                        float("nan") if p["value"] is None else p["value"],
                        float("nan") if p.get("stderr") is None else p["stderr"],
                    ]
                    for name, p in m["parameters"].items()
                }
                for m in missing
            ],
            "sizes": self.truth["sizes"],
        }
        return size_error(line)

    def held_out(self, method: str) -> float | None:
        """Error 0.1 s ahead over the noise, root mean square over held-out recordings; None where it is not known.

        `method` is base, extended, free_form or oracle.
        """
        ratios = []
        for name, fit in self.verdict.get("fit", {}).items():
            if fit["role"] != "holdout":
                continue
            if method in ("base", "extended"):
                error = fit[method]["prediction_rmse"]
            elif method == "free_form":
                error = self.rivals.get("free_form", {}).get("holdout", {}).get(name, [None, None])[1]
            else:
                error = self.witness.get("ahead", {}).get(name)
            if error is None:
                return None
            ratios.append(error / fit["noise_floor"])
        return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else None

    @property
    def recovery(self) -> float | None:
        """(base - named) / (base - oracle) of the held-out error; None where base and oracle differ by less than 5 %,
        so that there is nothing to recover."""
        base, named, oracle = (self.held_out(method) for method in ("base", "extended", "oracle"))
        if base is None or named is None or oracle is None or base < 1.05 * oracle:
            return None
        return (base - named) / (base - oracle)

    @property
    def located(self) -> tuple[bool, float] | None:
        """Whether the regime that stands first in the map is the one that holds most of the effect's energy, and the
        part of the energy that it holds; None where nothing was found or the energy is not known."""
        regimes = [cell for cell in self.verdict.get("mismatch", []) if cell["axis"] == "regime"]
        energy = self.witness.get("energy", {})
        if not regimes or not energy or self.verdict["verdict"] == "adequate":
            return None
        top = max(regimes, key=lambda cell: cell["share"])["bin"]
        return top == max(energy, key=lambda name: energy[name]), energy.get(top, 0.0)

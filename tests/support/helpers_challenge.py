"""Hand-made truths and verdicts of the blind challenge, and a batch without simulated machines."""

from benchmarks.concealed.answers import Answer
from benchmarks.concealed.seal import close, digest_of_case

NOISE = 1e-6


def truth(stratum, *missing, strength="strong", sizes=None, families="default"):
    """A case's truth as sealed."""
    own = {"stratum": stratum, "missing": list(missing), "strength": strength, "sizes": sizes or {}}
    return own | {"families": families}


def verdict(*named, word=None, classes=None, base=10.0, extended=1.0, confidence=0.9, size=None):
    """A verdict that gives the names `named`; errors are over the noise, `size` is (parameter, value, stderr)."""
    parameters = {size[0]: {"value": size[1], "stderr": size[2]}} if size else {}
    missing = [
        {
            "effect": name,
            "class": list((classes or {}).get(name, (name,))),
            "confidence": confidence,
            "parameters": parameters,
        }
        for name in named
    ]
    fit = {
        "role": "holdout",
        "noise_floor": NOISE,
        "base": {"prediction_rmse": base * NOISE},
        "extended": {"prediction_rmse": extended * NOISE},
    }
    return {
        "verdict": word or ("named" if named else "adequate"),
        "missing": missing,
        "fit": {"holdout": fit},
        "mismatch": [
            {"axis": "regime", "bin": "sliding", "share": 0.7},
            {"axis": "regime", "bin": "stick", "share": 0.3},
        ],
        "candidates": [],
        "seconds": {"wall": 30.0},
    }


def answer(name, own, said, *, oracle=1.0, energy=None, rivals=None):
    """One case after the seal is broken; `oracle` is over the noise."""
    witness = {"ahead": {"holdout": oracle * NOISE}, "energy": energy or {}}
    return Answer(name, own, said, rivals or {}, witness)


def plain_batch(folder, cases=3):
    """A sealed batch of folders that hold a case file each, and nothing to diagnose; returns the folder."""
    own = {}
    for number in range(1, cases + 1):
        case = folder / "cases" / f"case_{number:03d}"
        case.mkdir(parents=True)
        (case / "case.toml").write_text(f'name = "{case.name}"\n')
        own[case.name] = truth("nothing") | {"files": digest_of_case(case)}
    close(folder, {"seed": 1, "cases": own})
    return folder

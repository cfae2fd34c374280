"""The verdict in plain words."""

from frictionjax.diagnosis.verdict import MissingEffect, RecordingFit, Unexplained


def summary_sentence(
    verdict: str,
    missing: tuple[MissingEffect, ...],
    unexplained: Unexplained,
    where: str,
    fits: tuple[RecordingFit, ...],
) -> str:
    """The sentence that opens the report.

    **Arguments:**

    - `verdict`: `"adequate"`, `"named"` or `"unknown"`.
    - `missing`: the named effects, strongest first.
    - `unexplained`: what remains.
    - `where`: where the base model's mismatch is, in words.
    - `fits`: the recordings, for the held-out errors.
    """
    if verdict == "adequate":
        return "Nothing significant is missing: the base model explains the recordings to the noise."
    before_after = _held_out(fits)
    if not missing:
        text = f"Something is missing that no effect of the catalogue explains. The mismatch is in: {where}."
        return f"{text} {_carried(unexplained)} {before_after}".strip() if unexplained.carried_by else text
    named = "; ".join(_named(effect) for effect in missing)
    text = f"Left out: {named}. It acts in: {where}. {before_after}"
    if verdict == "unknown":
        text += f" More is missing ({100 * unexplained.share:.0f} % of the misfit) that the catalogue does not explain."
        if unexplained.carried_by:
            text += f" {_carried(unexplained)}"
    return text.strip()


def _carried(unexplained: Unexplained) -> str:
    return (
        f"A map of the missing force over {unexplained.carried_by} removes {100 * unexplained.explains:.0f} % of what "
        "is left on held-out recordings."
    )


def _named(effect: MissingEffect) -> str:
    others = [name for name in effect.effect_class if name != effect.effect]
    text = effect.sentence
    if others:
        text += f" (these recordings cannot tell it from {', '.join(others)})"
    return text


def _held_out(fits: tuple[RecordingFit, ...]) -> str:
    held = [fit for fit in fits if fit.role == "holdout"]
    if not held:
        return ""
    best = max(held, key=lambda f: f.prediction_rmse_base / max(f.prediction_rmse_extended, 1e-300))
    verb = "falls" if best.prediction_rmse_extended < best.prediction_rmse_base else "does not fall: it goes"
    return (
        f"On the held-out recording {best.name} the error 0.1 s ahead {verb} from {best.prediction_rmse_base:.3g} to "
        f"{best.prediction_rmse_extended:.3g} (noise {best.noise_floor:.2g})."
    )

"""`reveal`: break the seal, score, print tables, write results and a report with the pictures."""

from __future__ import annotations

import base64
import html
import io
import json
import sys
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.concealed.answers import Answer
from benchmarks.concealed.figures import figures
from benchmarks.concealed.scores import scores
from benchmarks.concealed.seal import SEAL, open_seal
from benchmarks.concealed.solve import RIVALS, SOLVED, VERDICT, strict
from benchmarks.concealed.solver import FILE
from benchmarks.concealed.tables import TABLES
from benchmarks.concealed.witness import witness

WITNESS = "witness.json"
_CAPTIONS = {
    "hero": "One case, chosen by rule: the right name, nine tenths of the error recovered, base near the noise.",
    "confusion": "What was said for what was concealed; how alike the effects' columns are, base parameters free.",
    "power": "Noticed and named, against strength; the point at nothing is the rate of false alarms.",
    "held_out": (
        "Error 0.1 s ahead on held-out recordings. The oracle is the simulator itself: true structure and parameters, "
        "states watched through the same noise."
    ),
    "reliability": "Reliability of the confidence, and p-values of every effect where nothing is hidden.",
    "cannot_tell": "Below these sizes an effect does not show, as the verdicts themselves state it.",
}
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#1a1a1a}"
    "table{border-collapse:collapse;margin:1em 0}td,th{border-bottom:1px solid #ddd;padding:.25em .7em;text-align:left}"
    "img{max-width:100%}figure{margin:2em 0}figcaption{color:#555}code{font-size:90%}"
)


def answers_of(batch: Path, *, look: bool = True) -> list[Answer]:
    """The cases of a `batch` that are solved, with their truths. With `look` the simulator is asked as a witness; its
    words are kept beside the truth, so that a second call is quick.

    Raises `BrokenSeal` when the truth or a case was changed.
    """
    truth = open_seal(batch)
    found = []
    for number, (name, own) in enumerate(sorted(truth["cases"].items()), start=1):
        folder = batch / SOLVED / name
        if not (folder / VERDICT).exists():
            continue
        verdict = _read(folder / VERDICT)
        rivals = _read(folder / RIVALS) if (folder / RIVALS).exists() else {}
        said: dict = {}
        if look:
            path = batch / "sealed" / name / WITNESS
            if not path.exists():
                path.parent.mkdir(exist_ok=True)
                path.write_text(json.dumps(strict(witness(own, verdict))) + "\n", encoding="utf-8")
            said = _read(path)
            sys.stderr.write(f"\rwitnessed {number} of {len(truth['cases'])}")
        found.append(Answer(name, own, verdict, rivals, said))
    sys.stderr.write("\n")
    return found


def _read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def reveal(batch: Path, out: Path, *, look: bool = True) -> dict:
    """Score a `batch` and write results.json, report.html and the figures as PNG into `out`; returns the results."""
    answers = answers_of(batch, look=look)
    if not answers:
        raise FileNotFoundError(f"no case of {batch} is solved yet; run `solve` first.")
    sealed, solver = _read(batch / SEAL), _read(batch / SOLVED / FILE)
    truth_seed = open_seal(batch)["seed"]
    results = {
        "seed": truth_seed,
        "sealed": sealed["sha256"],
        "solver": solver,
        "scores": scores(answers),
        "cases": {a.name: {"stratum": a.stratum, "missing": a.truth["missing"], "strength": a.truth["strength"],
                           "families": a.truth["families"], "rate": a.truth["rate"], "outcome": a.outcome,
                           "named": a.named, "evidence": a.verdict.get("evidence", []),
                           "verdict": a.verdict["verdict"]} for a in answers},
    }  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    drawn = figures(answers, results["scores"])
    for name, figure in drawn.items():
        figure.savefig(out / f"{name}.png")
    (out / "results.json").write_text(
        json.dumps(strict(results), indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    (out / "report.html").write_text(page(results, drawn), encoding="utf-8")
    return results


def markdown(results: dict) -> str:
    """All tables."""
    return "\n\n".join(f"### {head}\n\n{table(results['scores'])}" for head, table in TABLES.items())


def page(results: dict, drawn: dict[str, Figure]) -> str:
    """The report: one file that needs no other."""
    solver = results["solver"]
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>Concealed effects</title>",
        f"<style>{_STYLE}</style><h1>Concealed effects</h1>",
        f"<p>{results['scores']['cases']} cases, seed {results['seed']}, truth sealed as "
        f"<code>{results['sealed']}</code>; solved by frictionjax {html.escape(solver['frictionjax'])}, commit "
        f"<code>{html.escape(solver['commit'][:12])}</code>, {solver['cores']} cores.</p>",
    ]
    for name, figure in drawn.items():
        image = io.BytesIO()
        figure.savefig(image, format="png")
        data = base64.b64encode(image.getvalue()).decode("ascii")
        caption = html.escape(_CAPTIONS[name])
        parts.append(f"<figure><img alt='{name}' src='data:image/png;base64,{data}'>")
        parts.append(f"<figcaption>{caption}</figcaption></figure>")
    for head, table in TABLES.items():
        parts.append(f"<h2>{head}</h2>{_as_html(table(results['scores']))}")
    return "\n".join([*parts, "</html>\n"])


def _as_html(table: str) -> str:
    lines = [line.strip("| ").split(" | ") for line in table.splitlines()]
    head, rows = lines[0], lines[2:]
    cells = ["<tr>" + "".join(f"<th>{html.escape(c)}</th>" for c in head) + "</tr>"]
    cells += ["<tr>" + "".join(f"<td>{html.escape(c.strip())}</td>" for c in row) + "</tr>" for row in rows]
    return "<table>" + "".join(cells) + "</table>"

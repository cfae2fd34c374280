"""The seal: the truth as canonical JSON with a nonce, and its SHA-256 beside the cases."""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path

SEAL, TRUTH = "seal.json", "truth.json"
FOLDER = "sealed"


class BrokenSeal(ValueError):
    """The truth, or a case, is not what was sealed."""


def canonical(value: dict) -> bytes:
    """The one way to write `value` as JSON: sorted keys, no blanks, ASCII."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode("ascii")


def digest_of_case(folder: Path) -> str:
    """SHA-256 over the names and contents of the files of a case."""
    whole = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        content = path.read_bytes()
        whole.update(f"{path.name}\n{len(content)}\n".encode())
        whole.update(content)
    return whole.hexdigest()


def close(batch: Path, truth: dict) -> str:
    """Write the `truth` with a fresh nonce into the `batch`, its hash beside the cases; returns the hash."""
    sealed = canonical(truth | {"nonce": secrets.token_hex(32)})
    (batch / FOLDER).mkdir(parents=True, exist_ok=True)
    (batch / FOLDER / TRUTH).write_bytes(sealed)
    value = hashlib.sha256(sealed).hexdigest()
    public = {"sha256": value, "cases": len(truth["cases"]), "of": f"{FOLDER}/{TRUTH}, canonical JSON"}
    (batch / SEAL).write_text(json.dumps(public, indent=1) + "\n", encoding="utf-8")
    return value


def open_seal(batch: Path) -> dict:
    """The truth of a `batch`.

    Raises `BrokenSeal` when the truth is not the one whose hash stands beside the cases, or a case is not the one that
    was made.
    """
    path = batch / FOLDER / TRUTH
    if not path.is_file():
        raise BrokenSeal(
            f"{path} is missing: without the truth nothing can be scored; put it back where it was made."
        )
    content = path.read_bytes()
    wanted = json.loads((batch / SEAL).read_text(encoding="utf-8"))["sha256"]
    if hashlib.sha256(content).hexdigest() != wanted:
        raise BrokenSeal(
            f"{path} does not have the hash in {SEAL}: it was changed after it was sealed; restore it."
        )
    truth = json.loads(content)
    for name, case in truth["cases"].items():
        if digest_of_case(batch / "cases" / name) != case["files"]:
            raise BrokenSeal(
                f"{name} is not the case that was sealed: its files were changed; make the batch again."
            )
    return truth

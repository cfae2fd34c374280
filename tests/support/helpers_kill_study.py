"""`python helpers_kill_study.py FOLDER MOMENTS SEED`: studies that are killed at random moments, and run again.

Each run is a process of its own, copied from this one, which computes nothing and starts no thread before the last of
them has ended. Prints what was found, as JSON.
"""

import json
import os
import random
import signal
import sys
import time
import warnings
from pathlib import Path

import xarray
import zarr  # noqa: F401 -- loaded once, for all copies
from helpers_studies import noted_study, same

from frictionjax import load_study, run_study
from frictionjax.studies import shards

CASES, CHUNK, KILLS = 60, 3, 2


def started(store, notes):
    """The number of a new process that runs the study."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        os.environ["FRICTIONJAX_TEST_NOTES"] = str(notes)
        os.environ["FRICTIONJAX_TEST_PAUSE"] = "0.002"
        run_study(noted_study(CASES), store, chunk=CHUNK, progress=False)
        status = 0
    finally:
        os._exit(status)


def finished(store):
    """The places of the cases that are finished in the store."""
    if store.exists():
        return set(range(CASES))
    parts = store.with_name(f"{store.name}.parts")
    return {int(place) for places in shards.finished_places(parts) for place in places}


def killed_and_run_again(store, notes, wait, random_moment):
    """Kill runs on one store until one ends by itself; how many were killed, and what was lost or computed twice."""
    kills, lost, again, computed = 0, 0, 0, 0
    while True:
        before = finished(store)
        notes.write_text("")
        start = time.perf_counter()
        child = started(store, notes)
        if kills < KILLS:
            time.sleep(random_moment(wait))
            os.kill(child, signal.SIGKILL)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        own = [int(line) for line in notes.read_text().split()]
        computed += len(own)
        again += len(before & set(own))
        lost += len(before - finished(store))
        if status == 0:
            seconds = time.perf_counter() - start
            return {
                "kills": kills,
                "lost": lost,
                "again": again,
                "computed": computed,
                "status": status,
                "seconds": seconds,
            }
        if status != -signal.SIGKILL:
            return {"kills": kills, "status": status}
        kills += 1


def main(folder, moments, seed):
    """All moments, then the comparison with an undisturbed run."""
    warnings.simplefilter("ignore", RuntimeWarning)  # of JAX, with which the copies compute nothing
    rng = random.Random(seed)
    start = time.perf_counter()
    child = started(folder / "whole.zarr", folder / "notes")
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    wait = time.perf_counter() - start
    found, stores = [], []
    # The first run, which the moments are drawn by, may have been slower than the others: runs that ended before their
    # moment say how long one takes, and others are killed in their place.
    while (len(found) < moments or sum(run["kills"] for run in found) < moments) and len(found) < 5 * moments:
        stores.append(folder / f"{len(found)}.zarr")
        run = killed_and_run_again(
            stores[-1], folder / "notes", wait, lambda wait: rng.uniform(0.0, 1.05 * wait)
        )
        found.append(run)
        if run["status"]:
            break
        if not run["kills"]:
            wait = min(wait, run["seconds"])
    whole = load_study(folder / "whole.zarr")
    for store, run in zip(stores, found, strict=True):
        if run["status"] == 0:
            same(whole, load_study(store))
    left = sorted(path.name for path in folder.iterdir())
    sys.stdout.write(json.dumps({"runs": found, "left": left, "xarray": xarray.__version__}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))

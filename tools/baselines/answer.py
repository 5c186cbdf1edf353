"""Baselines for the blind check: answers a sealed folder, without its key, as bench.answers/1 (docs/blind.md).

    python tools/baselines/answer.py sindy blind/ -o sindy.json && bench blind stamp sindy.json

Methods: free-run (simulated without feedback from what was seen; RMSE and AIC choose), parameters (the rig's numbers re-fitted, never a cause),
sindy (PySINDy as a discrepancy model with direct statistics). Needs the packages in requirements.txt; nothing of the bench's own
code. A case that fails is answered `failed` with the reason.
"""

import argparse
import json
import multiprocessing
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: one case a core

METHODS = ["free-run", "parameters", "sindy"]


def answered(job):
    method, folder, name = job
    try:
        import free_run
        import recordings
        import sindy

        run = {"free-run": free_run.answer, "parameters": free_run.parameters_only, "sindy": sindy.answer}[method]
        return name, run(*recordings.case(Path(folder) / name))
    except Exception as error:  # whatever goes wrong with a case is its answer
        return name, {"verdict": "failed", "note": f"{type(error).__name__}: {error}"}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("method", choices=METHODS)
    parser.add_argument("folder", type=Path, help="sealed folder")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file for the answers")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="cases at a time (default: all cores)")
    arguments = parser.parse_args()
    try:
        seal = json.loads((arguments.folder / "seal.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        sys.exit(f"error: {arguments.folder} is no sealed folder: {error}")
    names = sorted({file.split("/")[0] for file in seal["files"]})
    began, cases = time.monotonic(), {}
    with multiprocessing.Pool(arguments.jobs) as pool:
        jobs = [(arguments.method, str(arguments.folder), name) for name in names]
        for name, answer in pool.imap_unordered(answered, jobs):
            cases[name] = answer
            if sys.stderr.isatty():
                print(f"\r{arguments.method}: {len(cases)} of {len(names)}", end="", file=sys.stderr)
    answers = {"schema": "bench.answers/1", "tool": f"baseline {arguments.method}", "seal": seal["key_sha256"], "sha256": "0" * 64,
               "cases": dict(sorted(cases.items()))}
    arguments.output.write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")
    failed = sum(answer["verdict"] == "failed" for answer in cases.values())
    print(f"\r{arguments.method}: {len(cases)} cases, {failed} failed, {time.monotonic() - began:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()

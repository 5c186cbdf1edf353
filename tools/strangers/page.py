"""The page of the strangers' cases: scores with Wilson's intervals of 95 %, as `bench blind open` gives them, and each case."""

import datetime
import hashlib
import json
import os
import platform
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
# In the blind check's words: a case of this d' or more is plain.
PLAIN = 10.0
RATES = [
    ("named rightly, all cases", "top_1.all"), ("no cause", "top_1.none"), ("single effects", "top_1.single"), ("single effects, d' 10 or more", "top_1.single_plain"),
    ("pairs, both right", "top_1.pair"), ("pairs, each of d' 10 or more, both right", "top_1.pair_plain"), ("pairs, at least one right", "half_of_pair"),
    ("outside the library", "top_1.outside"), ("outside the library, d' 10 or more", "top_1.outside_plain"), ("false alarms on no cause", "false_alarms"),
    ("group hits, not counted as named", "group_hits"), ("truth in the set", "set_coverage"), ("stage right", "stage"),
]
FIGURES = [("labels in the set", "set_size", 2), ("log score, nats", "log_score", 3), ("Brier score", "brier", 3), ("expected calibration error", "ece", 3)]


def seeds(path):
    """Simulator to its seed and how many cases."""
    found = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        words = line.split()
        if len(words) != 3 or not (words[1].isdigit() and words[2].isdigit()):
            raise SystemExit(f"error: {path}:{number}: expected a simulator, a seed and a number of cases, found {line!r}")
        found[words[0]] = int(words[1]), int(words[2])
    return found


def code_hash():
    """Hash of what makes cases: a page must not mix those of two."""
    digest = hashlib.sha256()
    for path in sorted([*HERE.glob("*.py"), HERE / "requirements.txt", *HERE.glob("rigs/**/*.toml")]):
        if path.name not in ("page.py", "test_strangers.py"):
            digest.update(path.read_bytes())
    return digest.hexdigest()


class Times:
    """Seconds of each step, kept with the work, which is refused where it was begun with something else."""

    def __init__(self, path, wanted):
        self.path = path
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"of": wanted, "seconds": {}}
        if kept["of"] != wanted:
            raise SystemExit(f"error: {path.parent} was begun with {kept['of']}, this is {wanted}; remove it, or name another with --work")
        self.kept, self.seconds = kept, kept["seconds"]

    def measure(self, step, what):
        # The time of a step that was interrupted is not that of the whole; it is told as unknown.
        resumed = step in self.seconds
        self.keep(step, None)
        began = time.monotonic()
        what()
        self.keep(step, None if resumed else time.monotonic() - began)

    def keep(self, step, seconds):
        self.seconds[step] = seconds
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(json.dumps(self.kept), encoding="utf-8")


def field(score, path):
    for name in path.split("."):
        score = score[name]
    return score


def rate(of):
    return f"{100 * of['value']:.0f} % ({of['count']} of {of['of']}; {100 * of['low']:.0f} to {100 * of['high']:.0f})" if of["of"] else "no cases"


def figure(of, digits):
    if of["value"] is None:
        return "-"
    return f"{of['value']:.{digits}f}" + ("" if of["low"] is None else f" ({of['low']:.{digits}f} to {of['high']:.{digits}f})")


def table(header, rows):
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in [header, ["---"] * len(header), *rows])


def seconds(x):
    return "interrupted" if x is None else f"{x:.0f} s"


def true_label(truth):
    return {"none": "none", "outside": "unknown"}.get(truth["family"]) or "+".join(sorted(put["effect"] for put in truth["ingredients"]))


def told(answer):
    if answer is None or answer["verdict"] == "failed":
        return "no answer"
    return "+".join(sorted(answer["effects"])) if answer["verdict"] == "effect" else answer["verdict"]


def page(runs):
    names = [run["simulator"].version for run in runs]
    heads = [
        ["cases", *(f"{run['score']['cases']} of {run['missions']} flights" + (", **a trial, not a result**" if run["trial"] else "") for run in runs)],
        ["rig", *(run["score"]["rig"] for run in runs)], ["seed", *(run["seed"] for run in runs)],
        ["seal", *(f"`{run['score']['seal'][:16]}`" for run in runs)], ["answers", *(f"`{run['score']['answers_sha256'][:16]}`" for run in runs)],
        ["program that answered", *(f"`{run['program'][:16]}`" for run in runs)],
        ["plain (d' 10 or more), of cases with a cause", *(plain(run["key"]) for run in runs)],
        ["time to fly and seal", *(seconds(run["times"].get("seal")) for run in runs)], ["time to answer", *(seconds(run["times"].get("answer")) for run in runs)],
    ]
    rows = [[name, *(rate(field(run["score"], path)) for run in runs)] for name, path in RATES]
    rows.append(["known causes called unknown", *(rate(known_unknown(run)) for run in runs)])
    rows += [[name, *(figure(field(run["score"], path), digits) for run in runs)] for name, path, digits in FIGURES]
    parts = [
        "# Strangers: results",
        f"Made by `tools/strangers/run` on {datetime.date.today()}, {os.cpu_count()} cores, {platform.machine()}; not edited. Cases in simulators that know nothing of the bench, with "
        "effects by their own features or wrapped around their forces; sealed, answered and scored as the [blind check](../blind.md)'s. What is put in, and how d' is computed: [strangers.md](../strangers.md). "
        "Intervals are of 95 %: Wilson's of rates, a bootstrap's of figures.",
        table(["", *names], heads), "## Scores", table(["", *names], rows),
        "## Detection against size", "Cases with a cause by detectability d', computed by twins without the cause along the same path.",
    ]
    # A score tells those bins alone that have cases.
    bins = sorted({(b["from"], b.get("to")) for run in runs for b in run["score"]["detection"]}, key=lambda b: b[0])
    parts.append(table(["d'", *(f"{name}: {what}" for name in names for what in ("seen", "named"))], [
        [f"{low:g} to {high:g}" if high else f"{low:g} or more", *(detected(run["score"], low, what) for run in runs for what in ("seen", "named"))] for low, high in bins]))
    for run in runs:
        parts += [f"## Cases of {run['simulator'].version}", table(["case", "put in", "size", "d'", "said", "probability of the truth"], [
            line(case, truth, run["answers"]["cases"].get(case)) for case, truth in sorted(run["key"]["cases"].items())])]
    return "\n\n".join(parts) + "\n"


def detected(score, low, what):
    return next((rate(b[what]) for b in score["detection"] if b["from"] == low), "no cases")


def plain(key):
    ds = [truth["detectability"] for truth in key["cases"].values() if truth["family"] != "none"]
    return f"{sum(d >= PLAIN for d in ds)} of {len(ds)}"


def known_unknown(run):
    known = [case for case, truth in run["key"]["cases"].items() if truth["family"] in ("single", "pair")]
    said = sum((run["answers"]["cases"].get(case) or {}).get("verdict") == "unknown" for case in known)
    low, high = wilson(said, len(known))
    return {"count": said, "of": len(known), "value": said / max(len(known), 1), "low": low, "high": high}


def wilson(count, of, z=1.959964):
    """Wilson's interval of 95 % of a rate."""
    if not of:
        return 0.0, 1.0
    p, d = count / of, 1.0 + z * z / of
    middle, half = (p + z * z / (2.0 * of)) / d, z * (p * (1.0 - p) / of + z * z / (4.0 * of * of)) ** 0.5 / d
    return max(0.0, middle - half), min(1.0, middle + half)


def line(case, truth, answer):
    put = truth["ingredients"]
    names = "; ".join(f"{x.get('effect') or 'outside'}: {x['form']}" for x in put) or "nothing"
    sizes = "; ".join(f"{x['size']:.3g} ({x['size_of']})" for x in put) or "-"
    label = true_label(truth)
    said = told(answer)
    probability = (answer or {}).get("probabilities", {}).get(label, 0.0)
    return [case, names, sizes, f"{truth['detectability']:.1f}" if put else "-", f"**{said}**" if said == label else said, f"{probability:.2f}"]

#!/usr/bin/env python3
"""How often `bench diff` calls two seeds of one rig and mission different, and how often a seed and a flight with an effect.

    tools/diff/false_alarms.py --rig rigs/virtual.toml --mission climb-040 --pairs 100
    tools/diff/false_alarms.py --rig rigs/virtual.toml --mission climb-040 --pairs 20 --effect thrust-loss:fraction=0.02

Run from the project's folder, with `bench` on the path or given by --bench.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import tempfile

arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
arguments.add_argument("--bench", default="bench")
arguments.add_argument("--rig", required=True)
arguments.add_argument("--mission", required=True)
arguments.add_argument("--pairs", type=int, default=100)
arguments.add_argument("--effect", action="append", default=[])
arguments.add_argument("--first-seed", type=int, default=1000)
options = arguments.parse_args()


def fly(path, seed, effects):
    command = [options.bench, "sim", "--rig", options.rig, "--mission", options.mission, "--seed", str(seed), "-o", path, "--force"]
    for effect in effects:
        command += ["--effect", effect]
    done = subprocess.run(command, capture_output=True, text=True)
    # A mission's criteria may be missed, a safety limit may end a flight: both are flights.
    if done.returncode not in (0, 1, 4):
        raise SystemExit(done.stderr)


different, first = 0, collections.Counter()
with tempfile.TemporaryDirectory() as folder:
    for pair in range(options.pairs):
        a, b = (str(pathlib.Path(folder, name)) for name in ("a.mcap", "b.mcap"))
        fly(a, options.first_seed + 2 * pair, [])
        fly(b, options.first_seed + 2 * pair + 1, options.effect)
        done = subprocess.run([options.bench, "diff", a, b, "--json"], capture_output=True, text=True)
        if done.returncode not in (0, 1):
            raise SystemExit(done.stderr)
        if done.returncode == 1:
            different += 1
            report = json.loads(done.stdout)
            counted = [field for field in report["fields"] if field["excluded"] is None]
            first.update(f"{field['channel']}/{field['field']}" for field in counted[:3] if field["verdict"] == "different")
print(f"{options.rig}, {options.mission}, {' '.join(options.effect) or 'nominal'}: {different} of {options.pairs} different")
for field, count in first.most_common(5):
    print(f"  {count:4} {field}")

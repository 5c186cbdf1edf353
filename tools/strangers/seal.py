"""Seals cases as the blind check does (docs/blind.md): what every case is goes into a key that is kept elsewhere, and the seal holds
its hash beside those of all files. `bench blind answer` and `bench blind open` take such a folder as one of their own."""

import hashlib
import json
import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path

from flight import fly
from recording import Template, records
from watch import Watch
import cases

ROOT = Path(__file__).resolve().parent.parent.parent
# Of the bench's missions for its blind check: a hop in the ground effect, a climb, steps, a low hover, a swept sine, drops.
MISSIONS = ["1-hop-high", "4-climb-080", "5-steps", "6-low", "7-chirp", "8-drops"]
# Time between two flights of a case, min.
BETWEEN_MIN = 0.5
FILLING = "\n# Filled up so that this flight's file is as long in every case:\n#"


class Simulator:
    """A simulator by its name: its world, its longest step [s], its nominal motors' time constant [s], and the rig that describes its airframe."""

    RIGS = {"rotorpy": "tools/strangers/rigs/rotorpy-crazyflie.toml", "mujoco": "rigs/virtual.toml"}

    def __init__(self, name):
        if name == "rotorpy":
            import rotorpy_world as own
            self.World, self.version = own.RotorPyWorld, version("rotorpy")
        else:
            import mujoco_world as own
            self.World, self.version = own.MuJoCoWorld, version("mujoco")
        self.name, self.STEP_S, self.MOTOR_S, self.rig = name, own.STEP_S, own.MOTOR_S, ROOT / self.RIGS[name]


def version(package):
    from importlib.metadata import version as of
    return f"{package} {of(package)}"


def templates(program, rig, folder):
    """A recording of the bench for each mission, flown by the program, as the form of those that are written."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for name in MISSIONS:
        path = folder / f"{name}.mcap"
        command = [program, "sim", "--rig", rig, "--mission", ROOT / f"rigs/missions/blind/{name}.toml", "-o", path, "--force"]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        # A mission's criteria may be missed, which is a flight all the same.
        if done.returncode not in (0, 1):
            sys.exit(f"error: {' '.join(map(str, command))} ended with {done.returncode}: {done.stderr}")
        made.append(Template(path))
    return made


def sha256(*parts):
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


def fly_case(work):
    """Flies a case's missions into its folder; returns its name, its truth and its files' lengths."""
    simulator, flown_templates, missions, case, truth, folder = work
    simulator = Simulator(simulator)
    rig, folder = flown_templates[0].rig, Path(folder)
    folder.mkdir(parents=True)
    watch, begins_min, sizes = Watch(rig, case), 0.0, []
    for i, (template, mission) in enumerate(zip(flown_templates, missions)):
        flown = fly(rig, mission, case, i, begins_min, simulator)
        watch.add(flown)
        sizes.append(template.write(folder / f"flight-{i + 1}.mcap", records(template, flown)))
        begins_min += sum(phase["duration_s"] for phase in mission["phase"]) / 60.0 + BETWEEN_MIN
    truth["detectability"], each = watch.detectability()
    for ingredient, seen in zip(truth["ingredients"], each):
        ingredient["detectability"] = seen
    return folder.name, truth, sizes


def fill_up(template, path, longest):
    """Fills a recording up by a comment in its mission, so that a flight's file is as long in every case whatever its content compresses to."""
    from mcap.reader import make_reader
    with open(path, "rb") as file:
        kept = [(channel.topic, message.log_time, message.publish_time, Raw(message.data)) for _, channel, message in make_reader(file).iter_messages(log_time_order=False)]
    bare = path.stat().st_size
    # The first line of the filling is in every file, also in that which is longest without.
    template.write(path, kept, FILLING + "." * (longest - bare) + "\n")


class Raw:
    def __init__(self, data):
        self.data = data

    def SerializeToString(self, deterministic=True):  # noqa: N802, as protobuf has it
        return self.data


def seal(program, name, count, seed, folder, key_file, jobs, say=lambda text: print(text, file=sys.stderr, flush=True)):
    """Draws and flies `count` cases into `folder`, which must not exist, and writes the key. Returns the seal."""
    folder, key_file = Path(folder), Path(key_file)
    for path in (folder, key_file):
        if path.exists():
            sys.exit(f"error: {path} is there already; remove it, or name another")
    if folder.resolve() in key_file.resolve().parents:
        sys.exit(f"error: the key {key_file} would lie in the sealed folder; name a place that whoever answers cannot read")
    import tomllib
    simulator = Simulator(name)
    forms = templates(program, simulator.rig, folder.parent / f"{folder.name}-templates")
    missions = [tomllib.loads(form.mission_toml) for form in forms]
    digits = max(3, len(str(count)))
    work = [(name, forms, missions, case, truth, str(folder / f"case-{i + 1:0{digits}}"))
            for i, (case, truth) in enumerate(cases.draw(forms[0].rig, count, seed))]
    folder.mkdir(parents=True)
    began, flown = time.monotonic(), []
    with multiprocessing.get_context("spawn").Pool(min(jobs, count)) as pool:
        for done in pool.imap_unordered(fly_case, work):
            flown.append(done)
            say(f"{name}: {len(flown)} of {count} cases flown, {time.monotonic() - began:.0f} s")
    flown.sort()
    longest = [max(sizes[i] for _, _, sizes in flown) for i in range(len(forms))]
    files, moment = {}, time.time()
    for case, _, _ in flown:
        for i, form in enumerate(forms):
            fill_up(form, folder / case / f"flight-{i + 1}.mcap", longest[i])
        (folder / case / "rig.toml").write_text(forms[0].rig_toml, encoding="utf-8")
        for path in sorted((folder / case).iterdir()):
            files[f"{case}/{path.name}"] = sha256(path.read_bytes())
            os.utime(path, (moment, moment))
    bench_version = forms[0].metadata["bench"]["bench_version"]
    key = {"schema": "bench.blind-key/1", "bench_version": bench_version, "salt": sha256(f"salt of {seed} in {name}".encode()), "seed": seed, "with_reserved": False,
           "rig": forms[0].rig.name, "cases": {case: truth for case, truth, _ in flown}}
    text = json.dumps(key, indent=2) + "\n"
    made = {"schema": "bench.blind-seal/1", "bench_version": bench_version, "key_sha256": sha256(text.encode(), key["salt"].encode()),
            "missions": [mission["name"] for mission in missions], "files": files}
    key_file.parent.mkdir(parents=True, exist_ok=True)
    key_file.write_text(text, encoding="utf-8")
    (folder / "seal.json").write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")
    return made

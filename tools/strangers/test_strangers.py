"""Tests of the strangers' laboratory: physics against closed forms, and one sealed case of each simulator that the bench reads.

    BENCH_PROGRAM=target/release/bench $(tools/strangers/run --python) -m unittest discover -s tools/strangers
"""

import json
import math
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np

import cases
import laws
import page
import seal
from flight import Case, fly
from rig import GRAVITY_M_S2, NUMBERS
from watch import Watch
from world import GRID_S, Airframe, air_series

SEED = 29
PROGRAM = os.environ.get("BENCH_PROGRAM")


def setUpModule():
    if not PROGRAM:
        raise RuntimeError("BENCH_PROGRAM must name the bench; build it first")
    global folder, forms, missions
    folder = tempfile.TemporaryDirectory()
    import tomllib
    forms, missions = {}, None
    for name in seal.Simulator.RIGS:
        forms[name] = seal.templates(PROGRAM, seal.Simulator(name).rig, Path(folder.name) / f"{name}-forms")
        missions = [tomllib.loads(form.mission_toml) for form in forms[name]]


def tearDownModule():
    folder.cleanup()


def still(name, faults=(), numbers=None):
    """A world in still air and its rig."""
    simulator, rig = seal.Simulator(name), forms[name][0].rig
    return simulator, rig, simulator.World(rig, Airframe(numbers or rig.numbers), list(faults), np.zeros(4000))


class Physics(unittest.TestCase):
    def test_at_rest_the_airframe_stays_on_the_floor(self):
        for name in forms:
            simulator, _, world = still(name)
            for _ in range(round(1.0 / simulator.STEP_S)):
                world.step(simulator.STEP_S)
            self.assertLess(abs(world.place()[2]), 1e-4, name)

    def test_a_climb_under_linear_drag_is_the_closed_form(self):
        for name in forms:
            simulator, rig, world = still(name)
            mass_kg, drag = rig.numbers[:2]
            world.heard = rig.throttle_for(1.2 * rig.weight_n)
            steps = round(2.0 / simulator.STEP_S)
            for _ in range(steps):
                world.step(simulator.STEP_S)
            rate = drag / mass_kg
            expected_m_s = 0.2 * GRAVITY_M_S2 / rate * -math.expm1(-2.0 * rate)
            # The cushion of the first 5 cm adds a push: below 0.3 weights over 5 cm, at most 0.3 g * 0.05 m / v. RotorPy's inflow drag grows
            # with rotor speed, here by sqrt(1.2), a tenth of the drag.
            most_m_s = 0.3 * GRAVITY_M_S2 * 0.05 / expected_m_s + 0.1 * rate * 2.0 * expected_m_s
            self.assertLess(abs(world.speed() - expected_m_s), most_m_s + 0.02, name)

    def test_a_fault_and_its_twin_differ_by_what_the_fault_does(self):
        for name in forms:
            simulator, rig, _ = still(name)
            size_n = 0.05 * rig.weight_n
            flown = fly(rig, missions[0], Case(rig.numbers, [laws.Bungee(size_n, 1.0)], 0.0), 0, 0.0, simulator)
            z, as_flown, nominal = flown.cells[:, 2], flown.cells[:, 5], flown.cells[:, 6]
            aloft = z > 0.02
            expected = size_n * np.maximum(1.0 - z[aloft], 0.0) / rig.numbers[0]
            # A step is at most 10 ms long, in which the airframe moves millimetres.
            self.assertLess(np.abs(as_flown[aloft] - nominal[aloft] - expected).max(), 0.02 * expected.max(), name)

    def test_a_twin_without_any_fault_is_no_other(self):
        for name in forms:
            simulator, rig, _ = still(name)
            flown = fly(rig, missions[0], Case(rig.numbers, [laws.Bungee(0.0, 1.0)]), 0, 0.0, simulator)
            watch = Watch(rig, Case(rig.numbers, [laws.Bungee(0.0, 1.0)]))
            watch.add(flown)
            self.assertLess(watch.detectability()[0], 0.05, name)

    def test_the_air_has_the_deviation_asked_for(self):
        air = air_series(np.random.default_rng(SEED), 4000.0, 0.03, 0.5)
        # 4000 s hold some 4000/(2 * 0.5 * 1.25) independent values: a deviation is known to 1/sqrt(2 * 3200), 1.3 %; three of these.
        self.assertLess(abs(air.std() / 0.03 - 1.0), 0.04)
        self.assertEqual(len(air), round(4000.0 / GRID_S) + 2)


class Laws(unittest.TestCase):
    def test_every_kind_can_be_made_and_flown_a_step(self):
        for name in forms:
            simulator, rig, _ = still(name)
            for kind in cases.KINDS:
                fault, size = cases.make(kind, np.random.default_rng(SEED), rig)
                self.assertTrue(kind.low <= abs(size) <= kind.high, kind.form)
                own = fault.fresh(np.random.default_rng(SEED))
                world = simulator.World(rig, Airframe(rig.numbers), [own], np.zeros(400))
                world.heard = rig.hover
                accelerations = [world.step(simulator.STEP_S) for _ in range(50)]
                self.assertTrue(np.isfinite(accelerations).all(), kind.form)

    def test_effects_are_those_of_the_library(self):
        told = json.loads(subprocess.run([PROGRAM, "effects", "--json"], check=True, capture_output=True, text=True).stdout)
        library = {effect["name"] for effect in (told if isinstance(told, list) else told["effects"])}
        self.assertEqual({kind.effect for kind in cases.KINDS if kind.effect} | {"tilt-loss"}, library)

    def test_a_thrust_law_is_the_rigs_at_hover(self):
        for law in (laws.ExponentialCurve(0.4, 0.1), laws.ExponentialCurve(-0.4, 0.1), laws.KinkedCurve(0.3, 0.1)):
            self.assertAlmostEqual(law.thrust(None, 0.1), 0.1)

    def test_output_laws_keep_to_their_size(self):
        plays, steps = laws.ThreePlays(0.1, 0.0), laws.Companded(0.05, 0.0, 1.9, 3.3)
        for asked in np.linspace(0.0, 3.0, 301):
            self.assertLessEqual(abs(plays.output(0.0, asked, 0.0) - asked), 0.05 + 1e-12)
        self.assertLessEqual(max(abs(steps.output(0.0, x, 0.0) - x) for x in np.linspace(1.8, 2.0, 101)), 0.03)


class Draws(unittest.TestCase):
    def test_shares_of_families_are_those_of_the_blind_check(self):
        self.assertEqual(cases.counts(300), cases.SHARES)
        self.assertEqual(sum(cases.counts(40).values()), 40)

    def test_a_seed_draws_the_same_cases(self):
        rig = forms["mujoco"][0].rig
        first, again, other = (json.dumps([truth for _, truth in cases.draw(rig, 20, seed)]) for seed in (SEED, SEED, SEED + 1))
        self.assertEqual(first, again)
        self.assertNotEqual(first, other)
        for _, truth in cases.draw(rig, 20, SEED):
            self.assertEqual(list(truth["nuisances_sigma"]), NUMBERS)

    def test_wilsons_interval(self):
        # Worked by hand: 8 of 10 with z = 1.96 is 0.490 to 0.943.
        low, high = page.wilson(8, 10)
        self.assertAlmostEqual(low, 0.490, 3)
        self.assertAlmostEqual(high, 0.943, 3)


class Sealed(unittest.TestCase):
    def test_one_case_of_each_is_sealed_read_answered_and_opened(self):
        for name in forms:
            sealed, key = Path(folder.name) / name, Path(folder.name) / f"{name}-key.json"
            made = seal.seal(PROGRAM, name, 1, SEED, sealed, key, 1, say=lambda text: None)
            text = key.read_bytes()
            self.assertEqual(made["key_sha256"], seal.sha256(text, json.loads(text)["salt"].encode()))
            self.assertEqual({str(p.relative_to(sealed)) for p in sealed.glob("*/*")}, set(made["files"]))
            for file, hashed in made["files"].items():
                self.assertEqual(seal.sha256((sealed / file).read_bytes()), hashed)
            truth = json.loads(text)["cases"]["case-001"]
            self.assertEqual(truth["family"], "single")
            self.assertGreater(truth["detectability"], 0.0)
            for flight in sorted(sealed.glob("*/*.mcap")):
                self.bench("check", flight)
            # Nothing in the sealed folder tells of truth, seed or cause.
            info = json.loads(self.bench("info", sealed / "case-001/flight-1.mcap", "--json"))
            self.assertIsNone(info["seed"])
            self.assertEqual({c["name"] for c in info["channels"]}, {"/tracker/position", "/control/state", "/control/command", "/dac/readback", "/loop/tick"})
            answers = Path(folder.name) / f"{name}-answers.json"
            self.bench("blind", "answer", sealed, "-o", answers)
            score = json.loads(self.bench("blind", "open", sealed, "--key", key, "--answers", answers, "--json"))
            self.assertEqual((score["cases"], score["failed"], score["missing"]), (1, [], []))

    def bench(self, *words):
        done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, f"{words}: {done.stdout} {done.stderr}")
        return done.stdout


if __name__ == "__main__":
    unittest.main()

"""Tests of tools/learn: what it takes from a diagnosis' JSON, and that its fit finds weights that made the truth."""

import importlib.machinery
import importlib.util
import json
import math
import sys
import tempfile
import unittest
import unittest.mock
from pathlib import Path

import numpy as np

sys.dont_write_bytecode = True
_loader = importlib.machinery.SourceFileLoader("learn_tool", str(Path(__file__).resolve().parent / "learn"))
tool = importlib.util.module_from_spec(importlib.util.spec_from_loader("learn_tool", _loader))
_loader.exec_module(tool)


def candidate(name, gain, nameless=None):
    grounds = {"grounds.flight": gain, "grounds.direct": 0.0, "grounds.nominal": 0.0}
    if nameless is not None:
        grounds |= {f"grounds.nameless.{kind}": nameless for kind in tool.KINDS} | {"grounds.nameless.readback": 0.0, "grounds.nameless.slight": 0.0}
    return {"name": name, "effects": [] if name == "none" else name.split("+"), "numbers": {"probability": 0.1, "evidence_gain": gain, **grounds}}


def case(domain, number, truth, candidates):
    family = {"none": "none", "unknown": "outside"}.get(truth, "pair" if "+" in truth else "single")
    unknown = {"name": "unknown", "effects": [], "numbers": {"probability": 0.1}}
    return {"schema": tool.SCHEMA, "domain": domain, "set": "s", "case": f"case-{number:04}", "family": family, "truth": truth, "detectability": 12.0, "numbers": {},
            "candidates": [*candidates, unknown]}


def row(random, domain, number, evidence, count=6):
    """A case whose truth is drawn by the decision that one believes: none, an effect or another cause, each with evidence of its own."""
    candidates = [candidate("none", 0.0, 0.0), *(candidate(f"effect-{i}", gain, 0.0) for i, gain in enumerate(random.normal(0.0, evidence, count)))]
    drawn = tool.Case(case(domain, number, "none", candidates))
    believed = tool.Decision()
    believed.x = BELIEVED
    p = np.array(believed.probabilities(drawn))
    return case(domain, number, drawn.labels[int(random.choice(len(p), p=p / p.sum()))], candidates)


BELIEVED = [-2.0, -8.0, -1.0, -4.5, -2.2, -3.0, -2.8, 0.0, -2.2, 2.3]


class Collected(unittest.TestCase):
    def test_every_number_has_a_path(self):
        told = {"a": {"b": 1, "c": [{"effect": "x", "name": "k", "value": 2.5}, 3]}, "traces": [1, 2], "word": "no", "nothing": None, "truth": True}
        self.assertEqual(tool.numbers(told), {"a.b": 1.0, "a.c.x.k.value": 2.5, "a.c.1": 3.0, "truth": 1.0})

    def test_labels_of_pairs_are_in_order(self):
        self.assertEqual(tool.truth("pair", ["rotor-lag", "gusts"])["truth"], "gusts+rotor-lag")
        self.assertEqual(tool.truth("outside", [None])["truth"], "unknown")
        self.assertTrue(tool.alike("rotor-lag+gusts", "gusts+actuator-lag"))
        self.assertFalse(tool.alike("rotor-lag", "gusts"))


class Decided(unittest.TestCase):
    def probabilities(self, *candidates, x=BELIEVED):
        decision = tool.Decision()
        decision.x = x
        decided = tool.Case(case("own", 0, "none", candidates))
        return dict(zip(decided.labels, decision.probabilities(decided)))

    def test_it_is_bayes_rule_without_doubt_misfit_forms_and_hidden_effects(self):
        plain = [-2.0, -8.0, -1.0, -40.0, -40.0, -40.0, -2.8, -40.0, -40.0, 2.3]
        told = self.probabilities(candidate("none", 0.0), candidate("a", 4.0), x=plain)
        self.assertAlmostEqual(math.log(told["a"] / told["none"]) - (4.0 - 2.0), 0.0, 6)

    def test_it_is_what_the_program_decides(self):
        # As the program's own test has it: `it_is_what_is_learnt` in crates/diagnosis/src/decision.rs.
        numbers = {"ln_prior_single": -3.5, "ln_prior_pair": -8.5, "ln_prior_unknown": -3.4, "misfit_share": 0.01, "doubt": 0.06, "form_probability": 0.03,
                   "form_share": 0.19, "hidden_share": 0.12, "nominal_misfit_probability": 0.7, "nominal_misfit_nats": 9.0}
        inverse = {"as it is": lambda y: y, "logarithm": math.log, "log odds": lambda y: math.log(y / (1.0 - y))}
        x = [inverse[scale](numbers[name]) for name, _, _, scale in tool.LEARNT]
        # A library of these two effects alone: of a larger one there would be pairs besides that nobody fitted.
        with unittest.mock.patch.object(tool, "LIBRARY", 2):
            told = self.probabilities(candidate("none", 0.0, 20.0), candidate("a", 30.0, 12.0), candidate("b", 24.0, 14.0), candidate("a+b", 33.0), x=x)
        for name, wanted in {"none": 0.0313, "a": 0.4525, "b": 0.0250, "a+b": 0.0007, "unknown": 0.4905}.items():
            self.assertAlmostEqual(told[name], wanted, 4, name)

    def test_a_pair_that_nobody_fitted_has_what_a_hidden_second_leaves(self):
        rows = case("own", 0, "a+b", [candidate("none", 0.0, 0.0), candidate("a", 50.0, 0.0)])
        decision = tool.Decision()
        decision.x = BELIEVED
        told = dict(zip(tool.Case(rows).labels, decision.probabilities(tool.Case(rows))))
        # The prior of a pair over that of one. Half of all effects are too small, so half of the pair is what the one alone is; nobody looked
        # at what the other half leaves, where of the one alone it is another form with probability q, at a share of nothing.
        value = decision.told()
        q, share = value["form_probability"], value["form_share"]
        form = 1.0 - q + q / (share * (1.0 - math.exp(-1.0 / share)))
        self.assertAlmostEqual(math.log(told["a+b"] / told["a"]), -6.0 + math.log((0.5 * form + 0.5) / (0.5 * form)), 2)


class Fitted(unittest.TestCase):
    def test_the_fit_finds_the_weights_that_made_the_truth(self):
        random = np.random.default_rng(29)
        cases = [tool.Case(row(random, "own", i, 4.0)) for i in range(1500)]
        learnt = tool.Decision().learn(cases).told()
        # Of 1,500 cases some 300 are `unknown` and some 500 `none`: logarithms of their odds are known to 0.07, and evidence takes its share.
        self.assertLess(abs(learnt["ln_prior_single"] + 2.0), 0.3)
        self.assertLess(abs(learnt["ln_prior_unknown"] + 1.0), 0.3)

    def test_a_table_becomes_a_page_and_numbers(self):
        random = np.random.default_rng(29)
        with tempfile.TemporaryDirectory() as folder:
            table, page, weights = (Path(folder) / name for name in ("t.jsonl", "p.md", "w.json"))
            table.write_text("".join(json.dumps(row(random, domain, i, 4.0)) + "\n" for domain in ("own", "blind") for i in range(40)))
            sys.argv = ["learn", "fit", str(table), "--before", str(table), "--output", str(page), "--weights", str(weights)]
            tool.main()
            self.assertIn("Each domain left out of the learning", page.read_text())
            self.assertIn("What the program before told", page.read_text())
            self.assertIn("All domains together", page.read_text())
            written = json.loads(weights.read_text())
            built_in = json.loads((Path(__file__).resolve().parent.parent / "crates/diagnosis/src/calibration.json").read_text(encoding="utf-8"))
            self.assertEqual(list(written), list(built_in))

    def test_rates_have_wilsons_interval(self):
        # Worked by hand: 8 of 10 is 0.490 to 0.943.
        self.assertEqual(tool.rate([True] * 8 + [False] * 2), "80 % (8 of 10; 49 to 94)")


if __name__ == "__main__":
    unittest.main()

"""Tests of tools/learn: what it takes from a diagnosis' JSON, and that its fit finds weights that made the truth."""

import importlib.machinery
import importlib.util
import json
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.dont_write_bytecode = True
_loader = importlib.machinery.SourceFileLoader("learn_tool", str(Path(__file__).resolve().parent / "learn"))
tool = importlib.util.module_from_spec(importlib.util.spec_from_loader("learn_tool", _loader))
_loader.exec_module(tool)


def row(random, domain, number, weight, count=6):
    """A case whose truth is drawn by weight times evidence."""
    gains = [0.0, *random.normal(0.0, 3.0, count)]
    p = np.exp(weight * np.array(gains))
    true = int(random.choice(count + 1, p=p / p.sum()))
    names = ["none", *(f"effect-{i}" for i in range(count))]
    candidates = [{"name": name, "effects": [] if name == "none" else [name], "numbers": {"probability": 1.0 / (count + 1), "evidence_gain": gain}}
                  for name, gain in zip(names, gains)]
    family = "none" if true == 0 else "single"
    return {"schema": tool.SCHEMA, "domain": domain, "case": f"case-{number:04}", "family": family, "truth": names[true], "detectability": 12.0,
            "numbers": {"where.structure": 1.0}, "candidates": candidates}


class Collected(unittest.TestCase):
    def test_every_number_has_a_path(self):
        told = {"a": {"b": 1, "c": [{"effect": "x", "name": "k", "value": 2.5}, 3]}, "traces": [1, 2], "word": "no", "nothing": None, "truth": True}
        self.assertEqual(tool.numbers(told), {"a.b": 1.0, "a.c.x.k.value": 2.5, "a.c.1": 3.0, "truth": 1.0})

    def test_labels_of_pairs_are_in_order(self):
        self.assertEqual(tool.truth("pair", ["rotor-lag", "gusts"])["truth"], "gusts+rotor-lag")
        self.assertEqual(tool.truth("outside", [None])["truth"], "unknown")
        self.assertTrue(tool.alike("rotor-lag+gusts", "gusts+actuator-lag"))
        self.assertFalse(tool.alike("rotor-lag", "gusts"))


class Fitted(unittest.TestCase):
    def test_the_fit_finds_the_weight_that_made_the_truth(self):
        random = np.random.default_rng(29)
        cases = [tool.Case(row(random, "own", i, 0.5)) for i in range(2000)]
        model = tool.Model(["evidence"], 1e-3).learn(cases)
        # The information of a case is the variance of evidence under its probabilities; five deviations of the estimate.
        information = 0.0
        for case in cases:
            p, e = np.array(model.probabilities(case)), model.matrix(case)[:, 0]
            information += (p * e**2).sum() - (p * e).sum() ** 2
        self.assertLess(abs(model.weights[0] - 0.5), 5.0 / np.sqrt(information))

    def test_without_cases_enough_the_ridge_keeps_to_the_bayesian_answer(self):
        random = np.random.default_rng(29)
        cases = [tool.Case(row(random, "own", i, 0.5)) for i in range(5)]
        self.assertAlmostEqual(tool.Model(["evidence"], 1e6).learn(cases).weights[0], 1.0, 3)

    def test_a_table_becomes_a_page_and_weights(self):
        random = np.random.default_rng(29)
        with tempfile.TemporaryDirectory() as folder:
            table, page, weights = (Path(folder) / name for name in ("t.jsonl", "p.md", "w.json"))
            table.write_text("".join(json.dumps(row(random, domain, i, 1.0)) + "\n" for domain in ("own", "blind") for i in range(40)))
            sys.argv = ["domains", "fit", str(table), "--output", str(page), "--weights", str(weights)]
            tool.main()
            self.assertIn("own: left out", page.read_text())
            self.assertIn("evidence", json.loads(weights.read_text())["features"])

    def test_rates_have_wilsons_interval(self):
        # Worked by hand: 8 of 10 is 0.490 to 0.943.
        self.assertEqual(tool.rate([True] * 8 + [False] * 2), "80 % (8 of 10; 49 to 94)")


if __name__ == "__main__":
    unittest.main()

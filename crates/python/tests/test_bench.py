"""The Python package beside the program that BENCH_PROGRAM names: the same results, the same words."""

import csv
import faulthandler
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import unittest
from pathlib import Path

import bench
import nbclient
import nbformat
import numpy as np
import pandas as pd
import polars as pl

PROGRAM = os.environ["BENCH_PROGRAM"]
ROOT = Path(__file__).resolve().parents[3]
LAG = "rotor-lag:time_constant_s=0.15"


def program(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, cwd=ROOT, check=False)


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        cls.flight = cls.folder / "flight.mcap"
        cls.flown = bench.simulate(mission="hop", seed=3, output=cls.flight)

    def test_a_flight_has_the_bytes_of_the_program(self):
        same = self.folder / "same.mcap"
        told = program("sim", "--mission", "hop", "--seed", 3, "-o", same, "--json")
        self.assertEqual(self.flight.read_bytes(), same.read_bytes())
        told = json.loads(told.stdout)
        told["recording"]["path"] = str(self.flight)
        self.assertEqual(self.flown, told)

    def test_channels_are_what_the_program_exports(self):
        channels = bench.read(self.flight)
        held = {channel["name"]: channel["messages"] for channel in bench.info(self.flight)["channels"]}
        for name, fields in channels.items():
            table = self.folder / "channel.csv"
            program("export", self.flight, "-o", table, "--channel", name, "--force")
            with table.open(newline="") as file:
                rows = list(csv.reader(file))[1:]
            self.assertEqual((len(rows), len(rows[0])), (held[name], len(fields)), name)
            for (field, column), cells in zip(fields.items(), zip(*rows)):
                self.assertEqual(column.shape, (held[name],))
                if column.dtype == object:
                    self.assertEqual(list(column), list(cells), field)
                elif column.dtype == bool:
                    self.assertEqual([str(flag).lower() for flag in column], list(cells), field)
                else:
                    theirs = [float(cell) if cell else np.nan for cell in cells]
                    np.testing.assert_allclose(column.astype(float), theirs, rtol=0, atol=1e-9, err_msg=field)

    def test_pandas_and_polars_take_a_channel_as_it_is(self):
        position = bench.read(self.flight)["/tracker/position"]
        for frame in (pd.DataFrame(position), pl.DataFrame(position)):
            self.assertEqual(list(frame.columns), list(position))
            self.assertEqual(len(frame), len(position["position_m.z"]))
            self.assertEqual(frame["position_m.z"].max(), position["position_m.z"].max())
            self.assertEqual(frame["status"][0], "found")

    def test_recordings_are_compared(self):
        lagging = self.folder / "lagging.mcap"
        bench.simulate(mission="hop", seed=3, effects=LAG, output=lagging)
        self.assertEqual(bench.diff(self.flight, self.flight, exact=True)["verdict"], "same")
        found = bench.diff(self.flight, lagging, absolute={"position_m.z": 0.001}, ignore="pixel.*")
        self.assertEqual(found["verdict"], "different")
        again = self.folder / "again.mcap"
        bench.simulate(mission="hop", seed=4, output=again)
        self.assertEqual(bench.diff(self.flight, again, floor=[self.flight, again])["verdict"], "within-tolerance")

    def test_an_effect_is_found_and_drawn(self):
        flights = []
        for seed, mission in enumerate(["hop", "climb-040", "steps"]):
            flights.append(self.folder / f"{mission}.mcap")
            bench.simulate(mission=mission, seed=seed, effects=LAG, output=flights[-1])
        page, better = self.folder / "page.html", self.folder / "better.toml"
        found = bench.diagnose(flights, html=page, write_rig=better)
        self.assertEqual((found["verdict"], found["effects"]), ("effect", ["rotor-lag"]))
        # The page says how to make it again, by the command line.
        self.assertIn("bench diagnose", page.read_text())
        self.assertIn("rotor-lag", better.read_text())
        figure = bench.plot(found)
        probable, ahead = figure.axes
        self.assertIn("rotor-lag leads", figure.get_suptitle())
        self.assertEqual(probable.get_yticklabels()[-1].get_text(), found["candidates"][0]["name"])
        heights = {round(patch.get_height() / 100, 9) for patch in ahead.patches}
        self.assertIn(round(found["gap"]["k_step_m"]["nominal"][1]["value"], 9), heights)
        self.assertEqual(len({bar.get_facecolor() for bar in ahead.get_legend().legend_handles}), 3)
        self.assertTrue(figure._repr_png_().startswith(b"\x89PNG"))

    def test_a_sweep_is_run(self):
        plan = self.folder / "plan.toml"
        plan.write_text(
            'name = "few"\ndescription = "A few flights"\nrigs = ["virtual"]\nmissions = ["hop"]\nseeds = { first = 0, count = 3 }\n'
            '[[variant]]\nname = "nominal"\n'
        )
        swept = bench.sweep(plan, self.folder / "swept", jobs=2)
        self.assertEqual((swept["runs"], swept["outcomes"]["passed"]), (3, 3))
        self.assertEqual(len(pl.read_parquet(swept["results"])), 3)

    def test_a_sweep_is_interrupted_and_goes_on(self):
        def interrupt(*_):
            raise KeyboardInterrupt

        folder, plan = self.folder / "interrupted", self.folder / "many.toml"
        # They take minutes.
        plan.write_text(
            'name = "many"\ndescription = "Many flights"\nrigs = "virtual"\nmissions = "climb-040"\nruns_per_part = 1\n'
            "seeds = { first = 0, count = 10000 }\n"
        )
        before = signal.signal(signal.SIGALRM, interrupt)
        self.addCleanup(signal.signal, signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with self.assertRaises(KeyboardInterrupt):
            bench.sweep(plan, folder, jobs=2)
        self.assertEqual(bench.sweep(folder, shard="1/10000")["runs"], 1)

    def test_errors_are_in_the_words_of_the_program(self):
        absent = self.folder / "absent.mcap"
        wrong = [
            (lambda: bench.simulate("vitual", output=absent), ["sim", "--rig", "vitual", "-o", absent]),
            (lambda: bench.simulate(effects="rotor-lag", output=absent), ["sim", "--effect", "rotor-lag", "-o", absent]),
            (lambda: bench.simulate(mission="hop", output=self.flight), ["sim", "--mission", "hop", "-o", self.flight]),
            (lambda: bench.simulate(model="flat"), ["sim", "--model=flat"]),
            (lambda: bench.diff(self.flight, absent), ["diff", self.flight, absent]),
            (lambda: bench.diagnose(absent), ["diagnose", absent]),
            (lambda: bench.diagnose(self.flight, min_confidence=2), ["diagnose", self.flight, "--min-confidence=2"]),
            (lambda: bench.import_log(self.flight, absent), ["import", self.flight, "-o", absent]),
            (lambda: bench.sweep("absent"), ["sweep", "run", "absent"]),
            (lambda: bench.info(absent), ["info", absent]),
        ]
        for call, words in wrong:
            with self.subTest(words=words[0]), self.assertRaises(bench.BenchError) as raised:
                call()
            told = program(*words)
            self.assertEqual(told.returncode, 2, told)
            self.assertEqual(f"error: {raised.exception}", told.stderr.split("\n\n")[0].rstrip("\n"))
        with self.assertRaisesRegex(bench.BenchError, "not a recording"):
            bench.read(ROOT / "README.md")

    def test_other_threads_run_meanwhile(self):
        # A pipe keeps the reader until somebody opens its other end, which another thread can do only while the reader does not hold
        # the global lock. If it did, this process would hang: it is ended then.
        pipe = self.folder / "pipe"
        os.mkfifo(pipe)
        errors = []

        def read():
            try:
                bench.read(pipe)
            except bench.BenchError as error:
                errors.append(error)

        faulthandler.dump_traceback_later(120, exit=True)
        reader = threading.Thread(target=read)
        reader.start()
        with pipe.open("wb"):
            pass
        reader.join()
        faulthandler.cancel_dump_traceback_later()
        self.assertEqual(len(errors), 1)

    def test_types_are_right_and_wrong_ones_are_found(self):
        def checked(text):
            code = self.folder / "typed.py"
            code.write_text(text)
            mypy = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", self.folder / "mypy", code]
            return subprocess.run(mypy, capture_output=True, text=True, check=False)

        right = checked("import bench\nz = bench.read('a.mcap')['/plant/truth']['position_m.z'].max()\nbench.plot(bench.diagnose(['a.mcap'], above=0.3))\n")
        self.assertEqual(right.returncode, 0, right.stdout)
        wrong = checked("import bench\nbench.simulate(seed='one')\nbench.read(1)\n")
        self.assertIn("Found 2 errors", wrong.stdout)

    def test_the_notebook_goes_from_logs_to_the_effect_that_was_flown(self):
        notebook = nbformat.read(ROOT / "docs/python.ipynb", as_version=4)
        nbformat.validate(notebook)
        client = nbclient.NotebookClient(notebook, timeout=None, resources={"metadata": {"path": self.folder}})
        client.execute()
        *_, drawn, told = (cell for cell in notebook.cells if cell.cell_type == "code")
        self.assertTrue(any("image/png" in output.get("data", {}) for output in drawn.outputs), drawn.outputs)
        self.assertIn("effect ['battery-discharge']", told.outputs[0]["text"])


if __name__ == "__main__":
    unittest.main()

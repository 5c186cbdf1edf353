"""A picture of a diagnosis, by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

# So many candidates are drawn at most.
MOST = 8
HORIZONS_S = (0.5, 1.0, 2.0)
LEVELS = {"nominal": "rig as it is", "parameters_only": "numbers re-fitted", "with_effect": "with the effect"}


class Picture(Figure):
    """A figure that notebooks show, whichever way they show others."""

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.savefig(png, format="png")
        return png.getvalue()


def draw(diagnosis: Mapping[str, Any]) -> Figure:
    figure = Picture(figsize=(10, 4), layout="constrained")
    figure.suptitle(f"{diagnosis['verdict']}: {diagnosis['leading']} leads with {diagnosis['confidence']:.0%}")
    probable, ahead = figure.subplots(1, 2)

    candidates = diagnosis["candidates"][:MOST][::-1]
    names = [candidate["name"].replace("+", " + ") for candidate in candidates]
    colours = ["C0" if candidate["name"] == diagnosis["leading"] else "lightgrey" for candidate in candidates]
    probable.barh(names, [100 * candidate["probability"] for candidate in candidates], color=colours)
    probable.set(xlim=(0, 100), xlabel="probability, %", title="Candidates")

    width = 0.8 / len(LEVELS)
    for place, (level, label) in enumerate(LEVELS.items()):
        told = [(at, error) for at, error in enumerate(diagnosis["gap"]["k_step_m"][level]) if error]
        where = [at + (place - 1) * width for at, _ in told]
        values = [100 * error["value"] for _, error in told]
        below = [max(100 * (error["value"] - error["low"]), 0) for _, error in told]
        above = [max(100 * (error["high"] - error["value"]), 0) for _, error in told]
        if told:
            ahead.bar(where, values, width, yerr=[below, above], color=f"C{place}", label=label)
    ahead.set(xlabel="seconds ahead", ylabel="RMS error, cm", title="Predictions")
    ahead.set_xticks(range(len(HORIZONS_S)), [f"{seconds:g}" for seconds in HORIZONS_S])
    ahead.legend()
    return figure

"""A hardware-in-the-loop test bench for very small aircraft: fly, record, compare, diagnose.

Each function does what the command of the same name does, and gives what the command prints with `--json` as a dict. Their keys are in
docs/schemas. What goes wrong is a BenchError with the words of the command line. Other Python threads run meanwhile.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from ._native import BenchError, __version__
from . import _native

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "BenchError",
    "__version__",
    "diagnose",
    "diff",
    "draft_rig",
    "identify_flight",
    "import_log",
    "info",
    "plot",
    "read",
    "simulate",
    "sweep",
]

Path = Union[str, "os.PathLike[str]"]
Paths = Union[Path, Iterable[Path]]
Result = dict[str, Any]


def read(recording: Path) -> dict[str, dict[str, np.ndarray]]:
    """The channels of a recording, each as its fields by name: what `pandas.DataFrame` and `polars.DataFrame` take as it is.

    Units are in the names; times are in seconds since the recording's origin. What was not measured is NaN, or an empty text.
    """

    def array(dtype: Optional[str], values: Any) -> np.ndarray:
        return np.array(values, dtype=object) if dtype is None else np.frombuffer(values, dtype)

    channels = _native.columns(os.fspath(recording))
    return {name: {field: array(*of) for field, of in fields.items()} for name, fields in channels.items()}


def info(recording: Path) -> Result:
    """What a recording holds (`bench info`)."""
    return _called(["info"], recording)


def simulate(
    rig: Path = "virtual",
    mission: Path = "climb-040",
    *,
    effects: Union[str, Iterable[str]] = (),
    seed: int = 0,
    output: Optional[Path] = None,
    model: Optional[str] = None,
    frames: bool = False,
    export: Optional[Path] = None,
    meta: Optional[Mapping[str, str]] = None,
    force: bool = False,
) -> Result:
    """Flies a mission in the virtual lab and records it (`bench sim`). The recording is at `["recording"]["path"]`.

    Effects are as `bench effects` lists them: `"rotor-lag:time_constant_s=0.08"`. A flight that misses its mission's criteria is no
    error: `["passed"]` tells.
    """
    return _called(
        ["sim"],
        rig=rig,
        mission=mission,
        effect=_several(effects),
        seed=seed,
        output=output,
        model=model,
        frames=frames,
        export=export,
        meta=[f"{key}={value}" for key, value in (meta or {}).items()],
        force=force,
    )


def import_log(
    log: Path,
    output: Path,
    *,
    map: Optional[Path] = None,
    rig: Optional[Path] = None,
    force: bool = False,
) -> Result:
    """Turns a flight log into a recording (`bench import`)."""
    return _called(["import"], log, output=output, map=map, rig=rig, force=force)


def draft_rig(
    logs: Paths,
    output: Path,
    *,
    map: Optional[Path] = None,
    mass_kg: Optional[float] = None,
    force: bool = False,
) -> Result:
    """Drafts a rig from nominal logs or recordings (`bench rig from-log`)."""
    return _called(["rig", "from-log"], *_several(logs), output=output, map=map, mass_kg=mass_kg, force=force)


def identify_flight(
    flights: Paths,
    output: Path,
    *,
    rig: Optional[Path] = None,
    above: Optional[float] = None,
    without: Union[str, Iterable[str]] = (),
    force: bool = False,
) -> Result:
    """Narrows a rig by nominal flights (`bench identify flight`)."""
    return _called(
        ["identify", "flight"],
        *_several(flights),
        output=output,
        rig=rig,
        above=above,
        without=_several(without),
        force=force,
    )


def diff(
    a: Path,
    b: Path,
    *,
    align: Optional[str] = None,
    tolerances: Optional[Path] = None,
    absolute: Optional[Mapping[str, float]] = None,
    relative: Optional[Mapping[str, float]] = None,
    time: Optional[Mapping[str, float]] = None,
    ignore: Union[str, Iterable[str]] = (),
    floor: Iterable[Path] = (),
    exact: bool = False,
    html: Optional[Path] = None,
    force: bool = False,
) -> Result:
    """Compares two recordings, field by field (`bench diff`). `["verdict"]` tells how they differ."""

    def limits(of: Optional[Mapping[str, float]]) -> list[str]:
        return [f"{field}={limit}" for field, limit in (of or {}).items()]

    # Two and more stand behind one flag.
    repeats = [_word(flight) for flight in floor]
    return _called(
        ["diff", *(["--floor", *repeats] if repeats else [])],
        a,
        b,
        align=align,
        tolerances=tolerances,
        abs=limits(absolute),
        rel=limits(relative),
        time=limits(time),
        ignore=_several(ignore),
        exact=exact,
        html=html,
        force=force,
    )


def diagnose(
    flights: Paths,
    *,
    rig: Optional[Path] = None,
    nominal: Paths = (),
    model: Paths = (),
    map: Optional[Path] = None,
    above: Optional[float] = None,
    without: Union[str, Iterable[str]] = (),
    min_confidence: Optional[float] = None,
    calibrate: Optional[int] = None,
    calibration: Optional[Path] = None,
    write_calibration: Optional[Path] = None,
    write_rig: Optional[Path] = None,
    next_flight: Optional[Path] = None,
    between: Optional[str] = None,
    html: Optional[Path] = None,
    force: bool = False,
) -> Result:
    """Says where the gap between model and flights lies and which effect causes it (`bench diagnose`).

    `["verdict"]` is `effect`, `none`, `unknown` or `inconclusive`; `["leading"]` and `["confidence"]` tell what leads and how sure it is.
    `plot` draws it. Flights that were fine may be the model (`nominal`; `model` is another name): docs/your-flights.md.
    """
    return _called(
        ["diagnose"],
        *_several(flights),
        rig=rig,
        nominal=[*_several(nominal), *_several(model)],
        map=map,
        above=above,
        without=_several(without),
        min_confidence=min_confidence,
        calibrate=calibrate,
        calibration=calibration,
        write_calibration=write_calibration,
        write_rig=write_rig,
        next_flight=next_flight,
        between=between,
        html=html,
        force=force,
    )


def sweep(
    plan: Path,
    output: Optional[Path] = None,
    *,
    shard: Optional[str] = None,
    keep_recordings: Optional[str] = None,
    jobs: Optional[int] = None,
) -> Result:
    """Does the runs of a plan that are not done yet (`bench sweep run`). The table of all runs is the Parquet file at `["results"]`."""
    return _called(
        ["sweep", "run"], plan, output=output, shard=shard, keep_recordings=keep_recordings, jobs=jobs
    )


def plot(diagnosis: Mapping[str, Any]) -> Figure:
    """Draws a diagnosis: what is probable, and how far predictions are off. Needs matplotlib."""
    from ._plot import draw

    return draw(diagnosis)


def _several(of: Any) -> list[Any]:
    return [of] if isinstance(of, (str, os.PathLike)) else list(of)


def _called(command: list[str], *places: Any, **options: Any) -> Result:
    words = list(command)
    for key, value in options.items():
        flag = f"--{key.replace('_', '-')}"
        if value is True:
            words.append(flag)
        elif value is not None and value is not False:
            values = value if isinstance(value, list) else [value]
            words += [f"{flag}={_word(each)}" for each in values]
    words += ["--", *map(_word, places)]
    result: Result = json.loads(_native.call(words))
    return result


def _word(value: Any) -> str:
    return os.fspath(value) if isinstance(value, (str, os.PathLike)) else repr(value)

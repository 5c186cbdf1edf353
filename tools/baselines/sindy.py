"""PySINDy as a discrepancy model, and direct statistics of readbacks, ticks and frames.

What the nominal model leaves of the acceleration is regressed on a library of terms, one an effect, in the weak form (Messenger
and Bortz, Multiscale Modeling and Simulation 19, 2021): altitude is integrated twice by parts against test functions, so nothing
noisy is differentiated. PySINDy's forward regression (FROLS: Billings, Chen and Korenberg, International Journal of Control 49,
1989) chooses two terms on bags of windows; how often a term comes first is its probability. What shows outside of the altitude is
counted. Limits were set on the seeds of tools/blind-tuning-seeds.txt.
"""

import warnings

import numpy as np
import pysindy as ps
from scipy.signal import savgol_filter

from free_run import stage
from recordings import G

HALF_S, STRIDE_S = 0.45, 0.15
BAGS = 40
# A term has to explain so much, in deviations of what is left, to be taken for an effect.
LEAST = 0.5
# Which effects a term may be; those of one term cannot be told apart by it.
TERMS = {
    "lag": ["rotor-lag", "actuator-lag", "tracker-latency"],
    "curve": ["thrust-curve"],
    "square": ["quadratic-drag"],
    "descent": ["descent-thrust-loss"],
    "inflow": ["inflow-damping"],
    "charge": ["battery-discharge"],
    "load": ["battery-load"],
    "ground": ["ground-effect-shape"],
    "cushion": ["ground-effect-dynamic"],
    "ceiling": ["ceiling-effect"],
}
REGION = {"lag": "lagged-throttle", "curve": "throttle", "square": "speed", "descent": "speed", "inflow": "speed", "charge": "charge",
          "load": "lagged-throttle", "ground": "altitude", "cushion": "altitude", "ceiling": "altitude"}


def low_pass(x, dt, tau):
    out = np.empty_like(x)
    state = x[0]
    for i, value in enumerate(x):
        state += (value - state) * (1 - np.exp(-dt / tau))
        out[i] = state
    return out


def windows(rig, flight):
    """Rows of one flight: discrepancy, numbers' terms, effects' terms, each integrated against the test functions."""
    mass, drag, gain, offset, multiplier, height, _ = rig.numbers
    dt = rig.frame
    t = np.arange(flight.exposed[0], flight.exposed[-1], dt)
    z = np.interp(t, flight.exposed, flight.z)
    smooth = savgol_filter(z, 11, 2)
    v = savgol_filter(z, 11, 2, deriv=1, delta=dt)
    fine = np.arange(t[0] - 2.0, t[-1] + 1.0, 0.005)
    held = np.searchsorted(flight.command_t, fine, side="right") - 1
    pins = np.where(held >= 0, flight.readback[np.maximum(held, 0)], rig.low)
    free = np.maximum(0.0, gain * (pins - offset)) / mass
    at = lambda x: np.interp(t, fine, x)
    thrust, rate = at(low_pass(free, 0.005, 0.02)), at((free - low_pass(free, 0.005, 0.06)) / 0.06)
    bed = lambda reach: np.maximum(0.0, 1 - np.maximum(smooth, 0) / reach)
    edge = (multiplier - 1) * bed(height)
    lifted = thrust * (1 + edge)
    model = lifted - drag / mass * v - G
    charge = np.cumsum(thrust / G) * dt / 60
    load = at(low_pass((free / G) ** 1.5, 0.005, 0.6))
    numbers = {
        "gain": (rig.sigma[2] / gain) * lifted, "mass": -(rig.sigma[0] / mass) * lifted, "offset": -np.full_like(t, gain * rig.sigma[3] / mass),
        "drag": -rig.sigma[1] / mass * v, "multiplier": rig.sigma[4] * thrust * bed(height),
        "height": thrust * (multiplier - 1) * (bed(height + rig.sigma[5]) - bed(height)), "latency": -rig.sigma[6] * rate,
        "trim": np.full_like(t, 0.003 * G),
    }
    terms = {
        "lag": -rate, "curve": G * (thrust / G - 1) ** 2, "square": -np.abs(v) * v, "descent": -lifted * (1 - np.exp(-((np.maximum(0, -v) / 0.4) ** 2))),
        "inflow": -lifted * v, "charge": -lifted * charge, "load": -lifted * load, "ground": thrust * (np.exp(-np.maximum(smooth, 0) / height) - bed(height)),
        "cushion": -thrust * np.gradient(edge, dt), "ceiling": lifted * np.exp(-np.maximum(0, 0.95 - smooth) / 0.1),
    }
    half = int(HALF_S / dt)
    x = np.arange(-half, half + 1) / half
    phi = (1 - x**2) ** 4
    bend = (56 * x**2 - 8) * (1 - x**2) ** 2 / (half * dt) ** 2
    area = phi.sum()
    rows = []
    for centre in range(half, len(t) - half, max(1, int(STRIDE_S / dt))):
        window = slice(centre - half, centre + half + 1)
        if smooth[window].min() < 0.012:
            continue
        over = lambda signal: float(phi @ signal[window] / area)
        y = float(bend @ z[window] / area) - over(model)
        rows.append([y, *map(over, numbers.values()), *map(over, terms.values())])
    noise = rig.noise * np.sqrt((bend**2).sum()) / area
    return np.array(rows).reshape(-1, 1 + len(numbers) + len(terms)), noise


def force(rig, flights):
    """How often each term comes first, its share of the discrepancy, the numbers in sigma, and the noise that is left."""
    rows = []
    for flight in flights:
        own, noise = windows(rig, flight)
        rows.append(own)
    rows = np.concatenate(rows)
    if len(rows) < 40:
        return None
    # Air moves in every room: windows scatter more than the tracker's noise alone.
    rows /= np.hypot(noise, 0.02)
    count = 8
    y, numbers, terms = rows[:, 0], rows[:, 1 : 1 + count], rows[:, 1 + count :]
    # The tolerances are priors: a row each. What they explain is taken out of the discrepancy and of every term.
    prior = np.concatenate([numbers, np.eye(count)])
    left = lambda column: (lambda full: full - prior @ np.linalg.lstsq(prior, full, rcond=None)[0])(np.concatenate([column, np.zeros(count)]))
    fitted = np.linalg.lstsq(prior, np.concatenate([y, np.zeros(count)]), rcond=None)[0]
    rest, library = left(y), np.stack([left(column) for column in terms.T], axis=1)
    size = np.sqrt(np.mean(library**2, axis=0))
    usable = size > 1e-9
    library = library / np.where(usable, size, 1.0)
    first, coefficients = np.zeros(len(size)), np.zeros((BAGS, len(size)))
    random = np.random.default_rng(0)
    for bag in range(BAGS):
        # Neighbouring windows overlap: whole stretches are drawn, not windows.
        stretch = 40
        starts = random.integers(0, max(1, len(rest) - stretch), size=len(rest) // stretch + 1)
        pick = np.concatenate([np.arange(s, min(s + stretch, len(rest))) for s in starts])
        optimizer = ps.FROLS(max_iter=2)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            optimizer.fit(library[pick], rest[pick].reshape(-1, 1))
        history = np.abs(np.reshape(optimizer.history_, (-1, len(size))))
        first[np.argmax(history[history.any(axis=1).argmax()])] += 1 / BAGS
        coefficients[bag] = np.where(usable, np.ravel(optimizer.coef_), 0.0)
    mean = coefficients.mean(axis=0)
    spread = float(np.sqrt(np.mean((rest - library @ mean) ** 2)))
    return first, np.abs(mean), fitted, spread


def direct(rig, flights):
    """Effects that readbacks, ticks and frames show by themselves, with how far each is beyond its limit."""
    found = {}
    command = np.concatenate([f.command for f in flights])
    off = np.concatenate([f.readback[: len(f.command)] - f.command[: len(f.readback)] for f in flights])
    before = np.concatenate([np.concatenate([[f.command[0]], f.command[:-1]]) for f in flights])[: len(off)]
    command = np.clip(command, rig.low, rig.high)[: len(off)]
    usual = np.hypot(rig.readback_noise, rig.step / 12**0.5) + 1e-12
    moving = command > rig.low + 0.05 * (rig.high - rig.low)
    cut = moving & (off < -4 * usual)
    # A limit holds all high commands down and no low ones.
    if cut.sum() >= 3 and np.mean(cut[moving & (command >= np.quantile(command[cut], 0.1))]) > 0.8:
        found["actuator-saturation"] = cut.sum() / 3
        moving &= command < command[cut].min()
    if moving.sum() > 100:
        spread = off[moving].std() / usual
        if spread > 1.25 and "actuator-saturation" not in found:
            # Steps depend on the command alone; play depends on where it came from.
            way = np.sign(command - before)[moving]
            dragged = -np.corrcoef(way, off[moving])[0, 1] if way.std() > 0 else 0.0
            found["actuator-backlash" if dragged > 0.3 else "actuator-quantisation"] = spread / 1.25
    late = np.concatenate([f.lateness for f in flights])
    if np.mean(late > 0.008) > 0.0025:
        found["loop-overrun"] = np.mean(late > 0.008) / 0.0025
    lost = 1 - np.mean(np.concatenate([f.seen for f in flights]))
    if lost > 2.5 * max(rig.lost, 0.001):
        found["tracker-dropout"] = lost / (2.5 * max(rig.lost, 0.001))
    jitter = np.concatenate([np.diff(f.arrived) for f in flights]).std() / (1.6 * 2**0.5 * 1e-3)
    if jitter > 1:
        found["tracker-jitter"] = jitter
    bent = np.concatenate([(f.z[2:] - 2 * f.z[1:-1] + f.z[:-2])[(np.diff(f.exposed, 2) < 0.01) & (f.z[1:-1] > 0.05)] for f in flights])
    if len(bent) > 100:
        usual = rig.noise * 6**0.5
        core = np.sqrt(np.mean(np.clip(bent, -4 * usual, 4 * usual) ** 2)) / usual
        stray = np.mean(np.abs(bent) > 6 * usual)
        if stray > 0.001 and core < 1.35:
            found["tracker-outliers"] = stray / 0.001
        elif core > 1.12:
            found["tracker-noise"] = core / 1.12
    return found


def answer(rig, flights):
    shown = direct(rig, flights)
    weights = {effect: min(0.97, 0.7 + 0.3 * (1 - 1 / beyond)) for effect, beyond in shown.items()}
    region, seen = None, force(rig, flights)
    if seen and "tracker-jitter" not in shown:
        first, strength, numbers, spread = seen
        if strength.max() > LEAST * spread:
            region = list(REGION.values())[int(np.argmax(first))]
            for term, often in zip(TERMS, first):
                for effect in TERMS[term]:
                    weights[effect] = max(weights.get(effect, 0.0), 0.9 * float(often) / len(TERMS[term]))
            weights = {effect: weight for effect, weight in weights.items() if weight > 0.01}
        # Numbers far beyond their tolerances, or a gap that no term explains.
        if not weights and abs(numbers[0] - numbers[1]) > 5:
            weights |= {"mass-change": 0.4, "thrust-loss": 0.35}
        if not weights and spread > 2.2:
            weights["gusts"] = 0.5
    named = sorted(weights, key=lambda effect: -weights[effect])
    if not named:
        return {"verdict": "none", "probabilities": {"none": 0.7, "unknown": 0.1}}
    best = named[0]
    together = [effect for effect in named[1:] if weights[effect] > 0.6 and stage(effect) != stage(best)][:1]
    if together:
        label = "+".join(sorted([best, together[0]]))
        said = {label: 0.5, best: 0.2, together[0]: 0.1}
    else:
        total = max(1.0, sum(weights.values()) + 0.1)
        said = {effect: weight / total for effect, weight in weights.items()}
    said["none"] = max(0.0, 0.5 * (1 - sum(said.values())))
    out = {"verdict": "effect", "effects": [best, *together], "probabilities": said, "stage": stage(best)}
    return out | ({"region": region} if region else {})

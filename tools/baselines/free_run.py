"""Free-run simulation against what was seen: every effect fitted for the smallest RMSE, chosen by AIC.

The laws are those of docs/effects.md, written again. Effects that change no mean flight (noise, jitter, outliers, drop-outs,
gusts, overruns) cannot compete here; that is a limit of the method, not of its implementation.
"""

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from recordings import G

# Effect: its parameters as (name, start, low, high); several starts where the error has several valleys.
EFFECTS = {
    "tracker-latency": [("extra_s", 0.03, -0.2, 0.5)],
    "tracker-scale": [("scale_error", 0.01, -0.5, 0.5), ("bias_m", 0.0, -0.2, 0.2)],
    "actuator-lag": [("time_constant_s", 0.05, 1e-4, 2.0)],
    "actuator-saturation": [("high_thrust_to_weight", 1.1, 0.5, 3.0)],
    "actuator-quantisation": [("step_fraction", 0.01, 1e-4, 0.25)],
    "actuator-backlash": [("width_fraction", 0.01, 1e-4, 0.5)],
    "rotor-lag": [("time_constant_s", 0.05, 1e-4, 2.0)],
    "thrust-curve": [("curvature", 0.05, -1.0, 2.0)],
    "thrust-loss": [("fraction", 0.03, -0.5, 0.9)],
    "battery-discharge": [("loss_per_hover_minute", 0.03, 0.0, 1.0)],
    "battery-load": [("sag", 0.03, 0.0, 0.5), ("time_constant_s", 0.5, 0.02, 20.0)],
    "ground-effect-shape": [("stretch", 1.3, 0.1, 10.0)],
    "ground-effect-dynamic": [("time_constant_s", 0.1, 1e-3, 5.0)],
    "ceiling-effect": [("gain", 0.1, 0.0, 3.0), ("ceiling_m", 1.0, 0.3, 2.0)],
    "updraft": [("speed_m_s", 0.1, -5.0, 5.0)],
    "mass-change": [("fraction", 0.03, -0.5, 1.0)],
    "quadratic-drag": [("coefficient_n_s2_per_m2", 0.008, 0.0, 1.0)],
    "descent-thrust-loss": [("fraction", 0.05, 0.0, 0.9)],
    "inflow-damping": [("coefficient_s_per_m", 0.05, 0.0, 2.0)],
}
CODES = {name: code for code, name in enumerate(EFFECTS, start=1)}
STAGES = {"tracker": "tracker", "actuator": "actuator", "rotor": "propulsion", "thrust": "propulsion", "battery": "propulsion",
          "ground": "environment", "ceiling": "environment", "updraft": "environment", "gusts": "environment", "loop": "loop"}
DT = 0.01


def stage(effect):
    return STAGES.get(effect.split("-")[0], "airframe")


@njit(cache=True)
def simulate(numbers, code, p, ct, cu, low, high, step, weight, gain0, offset0, exposed, latency0):
    """Altitude at each exposure, from rest on the floor, under the commands alone."""
    mass, drag, gain, offset, multiplier, height, latency = numbers
    if code == 16:
        mass *= 1.0 + p[0]
    shift = latency - latency0 + (p[0] if code == 1 else 0.0)
    told = np.empty(len(exposed))
    z = v = charge = 0.0
    pin, heard, rotor, load, extra = low, low, 0.0, 0.0, multiplier - 1.0
    sat = offset0 + p[0] * weight / gain0
    t, next_command, frame = 0.0, 0, 0
    while frame < len(exposed):
        while next_command < len(ct) and ct[next_command] <= t:
            u = min(max(cu[next_command], low), high)
            if code == 4:
                u = min(u, sat)
            elif code == 6:
                half = 0.5 * p[0] * (high - low)
                u = min(max(pin, u - half), u + half)
            q = p[0] * (high - low) if code == 5 else step
            pin = low + q * np.round((u - low) / q) if q > 0 else u
            next_command += 1
        if code == 3:
            heard += (pin - heard) * (1.0 - np.exp(-DT / p[0]))
        else:
            heard = pin
        thrust = max(0.0, gain * (heard - offset))
        if code == 7:
            rotor += (np.sqrt(thrust) - rotor) * (1.0 - np.exp(-DT / p[0]))
            thrust = rotor * rotor
        elif code == 8:
            thrust = max(0.0, thrust * (1.0 + p[0] * (thrust - weight) / weight))
        elif code == 9:
            thrust *= 1.0 - p[0]
        elif code == 10:
            thrust *= max(0.0, 1.0 - p[0] * charge)
            charge += DT / 60.0 * thrust / weight
        elif code == 11:
            load += ((thrust / weight) ** 1.5 - load) * (1.0 - np.exp(-DT / p[1]))
            thrust *= max(0.0, 1.0 - p[0] * load)
        reach = height * (p[0] if code == 12 else 1.0)
        ground = (multiplier - 1.0) * max(0.0, 1.0 - max(z, 0.0) / reach)
        if code == 13:
            extra += (ground - extra) * (1.0 - np.exp(-DT / p[0]))
            ground = extra
        thrust *= 1.0 + ground
        if code == 14:
            thrust *= 1.0 + p[0] * np.exp(-max(0.0, p[1] - z) / 0.08)
        elif code == 18:
            thrust *= 1.0 - p[0] * (1.0 - np.exp(-((max(0.0, -v) / 0.4) ** 2)))
        elif code == 19:
            thrust -= p[0] * weight * v * np.sqrt(max(thrust, 0.0) / weight)
        wind = p[0] if code == 15 else 0.0
        force = thrust - drag * (v - wind)
        if code == 17:
            force -= p[0] * abs(v) * v
        before, at = z, t
        v += DT * (force / mass - 9.80665)
        z += DT * v
        if z < 0.0:
            z, v = 0.0, max(v, 0.0)
        t += DT
        while frame < len(exposed) and exposed[frame] - shift <= t:
            part = min(max((exposed[frame] - shift - at) / DT, 0.0), 1.0)
            told[frame] = before + part * (z - before)
            frame += 1
    if code == 2:
        told = told * (1.0 + p[0]) + p[1]
    return told


class Problem:
    def __init__(self, rig, flights):
        self.rig, self.flights = rig, flights
        self.seen = np.concatenate([flight.z for flight in flights])
        # Weighs the rig's tolerances against the flights; without it they would count for nothing among thousands of frames.
        self.scale = max(rig.noise, float(np.sqrt(np.mean((self.run(rig.numbers, 0, np.zeros(2)) - self.seen) ** 2))))

    def run(self, numbers, code, p):
        rig = self.rig
        return np.concatenate([
            simulate(numbers, code, p, f.command_t, f.command, rig.low, rig.high, rig.step, rig.weight, rig.numbers[2],
                     rig.numbers[3], f.exposed, rig.numbers[6])
            for f in self.flights
        ])

    def fit(self, effect=None):
        """Parameters, deviations, RMSE [m] and AIC of an effect, the rig's numbers fitted within their tolerances."""
        rig, own = self.rig, EFFECTS.get(effect, [])
        code = CODES.get(effect, 0)
        scale = np.concatenate([rig.sigma, [max(abs(start), 0.01) for _, start, _, _ in own]])
        start = np.concatenate([rig.numbers, [start for _, start, _, _ in own]]) / scale
        low = np.concatenate([rig.numbers - 4 * rig.sigma, [low for _, _, low, _ in own]]) / scale
        high = np.concatenate([rig.numbers + 4 * rig.sigma, [high for _, _, _, high in own]]) / scale
        low[:6] = np.maximum(low[:6], 1e-6 / scale[:6])

        def residuals(x):
            x = x * scale
            p = np.zeros(2)
            p[: len(own)] = x[7:]
            off = (self.run(x[:7], code, p) - self.seen) / self.scale
            return np.concatenate([off, (x[:7] - rig.numbers) / rig.sigma])

        found = least_squares(residuals, np.clip(start, low + 1e-9, high - 1e-9), bounds=(low, high), diff_step=1e-3, max_nfev=25)
        off = found.fun[: len(self.seen)] * self.scale
        mean = float(np.mean(off**2))
        spread = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))) * scale
        x = found.x * scale
        return {
            "effect": effect, "rmse": mean**0.5, "off": off, "count": len(own) + 7,
            "numbers": (x[:7] - rig.numbers) / rig.sigma,
            "parameters": [(name, float(v), float(s)) for (name, *_), v, s in zip(own, x[7:], spread[7:])],
        }


def independent(off):
    """How many of the errors are independent, those being a first-order process."""
    rho = float(np.clip(off[1:] @ off[:-1] / max(off @ off, 1e-12), 0.0, 0.9999))
    return max(10.0, len(off) * (1 - rho) / (1 + rho))


def answer(rig, flights):
    """The effect with the smallest AIC; probabilities are Akaike's weights."""
    problem = Problem(rig, flights)
    fits = [problem.fit(effect) for effect in [None, *EFFECTS]]
    # Frames a thirtieth of a second apart err together: as many count as are independent, by the least correlated fit.
    n = max(independent(fit["off"]) for fit in fits)
    for fit in fits:
        fit["aic"] = n * np.log(fit["rmse"] ** 2) + 2 * fit["count"]
    fits.sort(key=lambda fit: fit["aic"])
    best = fits[0]
    weights = np.exp(-0.5 * np.array([fit["aic"] - best["aic"] for fit in fits]))
    weights /= weights.sum()
    told = {fit["effect"] or "none": float(w) for fit, w in zip(fits, weights)}
    said = {"verdict": "none", "probabilities": told, "note": f"free-run RMSE {100 * best['rmse']:.2f} cm"}
    if best["effect"]:
        # 90 % of a normal number lies within 1.645 deviations.
        parameters = [
            {"effect": best["effect"], "name": name, "value": v, "low": v - 1.645 * s, "high": v + 1.645 * s}
            for name, v, s in best["parameters"]
            if np.isfinite(v) and np.isfinite(s)
        ]
        said |= {"verdict": "effect", "effects": [best["effect"]], "parameters": parameters, "stage": stage(best["effect"])}
    return said


def parameters_only(rig, flights):
    """The rig's numbers re-fitted: whatever is seen is put down to them, so there is never a cause."""
    fit = Problem(rig, flights).fit()
    off = ", ".join(f"{name} {x:+.1f}" for name, x in zip(["mass", "drag", "gain", "offset", "multiplier", "height", "latency"], fit["numbers"]))
    return {"verdict": "none", "probabilities": {"none": 1.0}, "note": f"in sigma: {off}; free-run RMSE {100 * fit['rmse']:.2f} cm"}

//! What flights achieved.

use bench_device::Sticks;
use bench_rig::{Phase, Rig};
use bench_statistics::root_mean_square;
use serde::Serialize;

use crate::flight::{CAPTURE_S, STEADY_S, STEP_S, Task, Traced};

/// How a flight held its place and changed it. Positions are the true ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// RMS error in steady hold, m: of altitude, or horizontal.
    pub rms_m: f64,
    /// Overshoot of a step, as a share of it.
    pub overshoot: f64,
    /// From the step until the band is never left again, s.
    pub settling_s: f64,
    /// RMS of the thrust asked for in steady hold about its mean, over the weight; or of the acceleration by tilt, over
    /// gravity.
    pub activity: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Along {
    X,
    Z,
}

impl Figures {
    /// Of altitude and its step. `None` where the flight did not get through it: it touched the ground, was stopped, or
    /// never flew.
    pub fn of_altitude(flight: &Traced, rig: &Rig, task: &Task) -> Option<Self> {
        let per_unit = rig.airframe.thrust.gain_n_per_unit.value / rig.airframe.weight_n();
        Self::of(flight, task, Along::Z, |sticks| [per_unit * sticks.throttle, 0.0])
    }

    /// Of place and a step along x.
    pub fn of_lateral(flight: &Traced, rig: &Rig, task: &Task) -> Option<Self> {
        let tilt = rig.airframe.sticks.tilt_rad_per_unit;
        Self::of(flight, task, Along::X, |sticks| [tilt * sticks.pitch, tilt * sticks.roll])
    }

    fn of(flight: &Traced, task: &Task, along: Along, effort: impl Fn(Sticks) -> [f64; 2]) -> Option<Self> {
        if !flight.complete {
            return None;
        }
        let begin = flight.began(Phase::Hold)?;
        let steady = [CAPTURE_S, CAPTURE_S + STEADY_S];
        let stepped = [steady[1], steady[1] + STEP_S];
        if flight.truth_between(begin, [CAPTURE_S, stepped[1]]).any(|(_, [.., z], _)| *z <= 0.0) {
            return None;
        }
        let error_m = |[x, y, z]: [f64; 3]| match along {
            Along::Z => z - task.altitude_m,
            Along::X => x.hypot(y),
        };
        let rms_m = root_mean_square(flight.truth_between(begin, steady).map(|(_, at, _)| error_m(*at)))?;

        let (from, to) = match along {
            Along::Z => (task.altitude_m, task.altitude_m + task.step_m),
            Along::X => (0.0, task.step_m),
        };
        let place = |[x, _, z]: [f64; 3]| if along == Along::Z { z } else { x };
        let (mut furthest, mut settling_s) = (from, 0.0);
        for (time, at, _) in flight.truth_between(begin, stepped) {
            furthest = place(*at).max(furthest);
            if (place(*at) - to).abs() > task.band_m {
                settling_s = time.since_s(begin) - stepped[0];
            }
        }
        let efforts: Vec<[f64; 2]> = flight
            .commands
            .iter()
            .filter(|(time, ..)| (steady[0]..steady[1]).contains(&time.since_s(begin)))
            .map(|(.., sticks)| effort(*sticks))
            .collect();
        let count = efforts.len().max(1) as f64;
        let mean = [0, 1].map(|i| efforts.iter().map(|x| x[i]).sum::<f64>() / count);
        let activity = root_mean_square(efforts.iter().map(|x| (x[0] - mean[0]).hypot(x[1] - mean[1])))?;
        Some(Self { rms_m, overshoot: (furthest - to).max(0.0) / task.step_m, settling_s, activity })
    }
}

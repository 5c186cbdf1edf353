//! The smoother: what was known at each measurement, given the whole flight.

use bench_plant::effects::Axis;

use crate::{
    covariance::{Covariance, IDENTITY, State},
    passenger::{Measured, Passenger, Propagated, Reset, Updated},
};

/// What the filter knew at a measurement: before it (predicted), after it, and how the state moved from the one before.
#[derive(Clone, Copy, Debug)]
pub struct Knot {
    /// Exposure, s from take-off.
    pub time_s: f64,
    /// Altitude as seen, m.
    pub seen_m: f64,
    /// Thrust over weight.
    pub ratio: f64,
    /// How far below where a ceiling stops it, m.
    pub below_ceiling_m: f64,
    /// State and covariance before the measurement.
    pub predicted: (State, Covariance),
    /// After it.
    pub filtered: (State, Covariance),
    /// Transition from the measurement before.
    pub transition: Covariance,
}

impl Knot {
    /// Whether the airframe touched ground or ceiling since the measurement before, or was carried: nothing is left of its speed then.
    pub fn is_cut(&self) -> bool {
        self.transition.iter().all(|row| row[1] == 0.0)
    }
}

/// Gathers what the smoother needs.
pub(crate) struct Knots {
    knots: Vec<Knot>,
    /// Transition since the last.
    since: Covariance,
}

impl Default for Knots {
    fn default() -> Self {
        Self { knots: Vec::new(), since: IDENTITY }
    }
}

impl Knots {
    pub(crate) fn into_knots(self) -> Vec<Knot> {
        self.knots
    }
}

impl Passenger for Knots {
    fn propagated(&mut self, step: &Propagated<'_>) {
        let Some(flown) = &step.flown else { return };
        let since = &mut self.since;
        for j in 0..4 {
            let moved = flown.transition.apply([since[0][j], since[1][j], since[2][j], since[3][j]]);
            for (row, value) in since.iter_mut().zip(moved) {
                row[j] = value;
            }
        }
    }

    fn updated(&mut self, update: &Updated<'_>) {
        let Measured::Altitude { measurement, below_ceiling_m, .. } = &update.measured else { return };
        self.knots.push(Knot {
            time_s: update.axes[Axis::Time as usize],
            seen_m: measurement.z_m,
            ratio: update.axes[Axis::ThrustToWeight as usize],
            below_ceiling_m: *below_ceiling_m,
            predicted: (*update.before.0, *update.before.1),
            filtered: (*update.after.0, *update.after.1),
            transition: std::mem::replace(&mut self.since, IDENTITY),
        });
    }

    fn reset(&mut self, reset: &Reset<'_>) {
        match reset {
            Reset::Standing | Reset::LiftOff(_) => {}
            Reset::Stopped { .. } => {
                self.since[0] = [0.0; 4];
                self.since[1] = [0.0; 4];
            }
            // Nothing that comes later tells of what was before.
            Reset::Carried { .. } => self.since = [[0.0; 4]; 4],
        }
    }
}

/// State and covariance at each knot, given the whole flight (Rauch, Tung and Striebel, Maximum likelihood estimates of
/// linear dynamic systems, AIAA Journal 3(8), 1965).
pub fn backward(knots: &[Knot]) -> Vec<(State, Covariance)> {
    use nalgebra::{Matrix4, Vector4};
    let matrix = |m: &Covariance| Matrix4::from_fn(|i, j| m[i][j]);
    let mut out: Vec<(State, Covariance)> = knots.iter().map(|knot| knot.filtered).collect();
    for k in (0..knots.len().saturating_sub(1)).rev() {
        let next = &knots[k + 1];
        if next.is_cut() {
            continue;
        }
        let (x, p) = (Vector4::from(knots[k].filtered.0), matrix(&knots[k].filtered.1));
        let predicted = matrix(&next.predicted.1) + Matrix4::identity() * 1e-14;
        let Some(inverse) = predicted.try_inverse() else { continue };
        let gain = p * matrix(&next.transition).transpose() * inverse;
        let x = x + gain * (Vector4::from(out[k + 1].0) - Vector4::from(next.predicted.0));
        let p = p + gain * (matrix(&out[k + 1].1) - predicted) * gain.transpose();
        let mut covariance = [[0.0; 4]; 4];
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                *value = p[(i, j)];
            }
        }
        out[k] = (x.into(), covariance);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Standing still at 1 m, 0.1 s apart, seen 1 cm higher the second time; with or without contact between.
    fn knots(cut: bool) -> Vec<Knot> {
        let spread = |m: f64| {
            let mut p = [[0.0; 4]; 4];
            (0..4).for_each(|i| p[i][i] = m * m);
            p
        };
        let mut transition = spread(1.0);
        transition[0][1] = 0.1;
        if cut {
            transition[0] = [0.0; 4];
            transition[1] = [0.0; 4];
        }
        let knot = |time_s, z_m: f64, filtered_m: f64, transition| Knot {
            time_s,
            seen_m: z_m,
            ratio: 1.0,
            below_ceiling_m: f64::INFINITY,
            predicted: ([1.0, 0.0, 0.0, 0.0], spread(0.02)),
            filtered: ([filtered_m, 0.0, 0.0, 0.0], spread(0.01)),
            transition,
        };
        vec![knot(0.0, 1.0, 1.0, spread(1.0)), knot(0.1, 1.01, 1.005, transition)]
    }

    #[test]
    fn what_comes_after_contact_tells_nothing_of_the_speed_before() {
        let free = backward(&knots(false));
        assert!(free[0].0[0] > 1.0 && free[0].0[1] > 0.0, "{:?}", free[0]);
        let touched = knots(true);
        assert!(touched[1].is_cut() && !touched[0].is_cut());
        assert_eq!(backward(&touched)[0], touched[0].filtered);
    }
}

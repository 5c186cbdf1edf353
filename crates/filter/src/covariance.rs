//! The filter's state with its covariance, and how both move, learn and are reset.

use crate::{measurement::Scored, noise::Noise};

/// Altitude, m; vertical speed, m/s; trim acceleration, m/s^2; turbulence, m/s^2.
pub type State = [f64; 4];
/// Covariance of a [`State`], row by row.
pub type Covariance = [[f64; 4]; 4];

pub(crate) const IDENTITY: Covariance =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]; // unit

/// Spread of altitude when the airframe leaves the ground, m.
pub const LIFT_OFF_M: f64 = 0.001;
/// Spread of the vertical speed of an airframe that was carried, m/s.
pub(crate) const CARRIED_M_S: f64 = 0.7;

/// What is known before a flight.
pub(crate) fn initial_covariance(noise: &Noise) -> Covariance {
    let mut p = [[0.0; 4]; 4];
    for (i, variance) in [1e-8, 1e-8, noise.trim.powi(2), noise.turbulence.powi(2)].into_iter().enumerate() {
        p[i][i] = variance;
    }
    p
}

/// How the state moves over a step, linearised: trim and turbulence push alike, and the turbulence forgets.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// Row of the altitude: by altitude, by speed, by a push.
    pub(crate) z: [f64; 3],
    /// The same of the speed.
    pub(crate) v: [f64; 3],
    /// What is left of the turbulence.
    pub(crate) kept: f64,
}

impl Transition {
    #[inline]
    pub(crate) fn apply(&self, [z, v, b, w]: State) -> State {
        let row = |f: &[f64; 3]| f[0] * z + f[1] * v + f[2] * (b + w);
        [row(&self.z), row(&self.v), b, w * self.kept]
    }

    /// Moves a covariance over a step of `h` seconds.
    #[inline]
    pub(crate) fn propagate_covariance(&self, p: &mut Covariance, h: f64, near_ground: bool, noise: &Noise) {
        let row =
            |f: &[f64; 3]| [0, 1, 2, 3].map(|j| f[0] * p[0][j] + f[1] * p[1][j] + f[2] * (p[2][j] + p[3][j]));
        let (fz, fv) = (row(&self.z), row(&self.v));
        let kink = if near_ground { noise.near_ground } else { 0.0 };
        let q = noise.acceleration.powi(2) + kink.powi(2);
        let dot = |a: &[f64; 4], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + (a[2] + a[3]) * b[2];
        let p00 = dot(&fz, &self.z) + q * h * h * h / 3.0; // unit
        let p01 = dot(&fz, &self.v) + q * h * h / 2.0;
        let p11 = dot(&fv, &self.v) + q * h;
        let (p02, p12) = (fz[2], fv[2]);
        let (p03, p13, p23) = (fz[3] * self.kept, fv[3] * self.kept, p[2][3] * self.kept);
        let p22 = p[2][2] + noise.trim_walk.powi(2) * h;
        let p33 = p[3][3] * self.kept * self.kept + noise.turbulence.powi(2) * (1.0 - self.kept * self.kept);
        *p = [[p00, p01, p02, p03], [p01, p11, p12, p13], [p02, p12, p22, p23], [p03, p13, p23, p33]];
    }
}

/// What legs and floor do as the airframe leaves the ground is not known.
pub(crate) fn lift_off_covariance(p: &mut Covariance, lift_off_m_s: f64) {
    p[0][0] += LIFT_OFF_M * LIFT_OFF_M;
    p[1][1] += lift_off_m_s.powi(2);
}

/// What is known of an airframe that is where it was seen.
pub(crate) fn reset_covariance(p: &mut Covariance, noise: &Noise) {
    let trim = p[2][2];
    *p = [[0.0; 4]; 4];
    p[0][0] = noise.measurement_m.powi(2);
    p[1][1] = CARRIED_M_S.powi(2);
    p[2][2] = trim;
    p[3][3] = noise.turbulence.powi(2);
}

/// What touching ground or ceiling leaves of a covariance.
pub(crate) fn stop_covariance(p: &mut Covariance) {
    p[0] = [1e-6, 0.0, 0.0, 0.0];
    p[1] = [0.0, 1e-3, 0.0, 0.0]; // numerical
    for row in &mut p[2..] {
        row[0] = 0.0;
        row[1] = 0.0;
    }
}

/// Variance of a measurement with slopes `h` by the state.
pub(crate) fn predicted_variance(p: &Covariance, h: &State) -> f64 {
    let along = |row: &State| row.iter().zip(h).map(|(p, h)| p * h).sum::<f64>();
    p.iter().zip(h).map(|(row, h)| h * along(row)).sum()
}

/// Takes a measurement with slopes `h` by the state into a covariance; the gain.
pub(crate) fn update_along(p: &mut Covariance, h: &State, scored: &Scored) -> State {
    let ph = p.map(|row| row.iter().zip(h).map(|(p, h)| p * h).sum::<f64>());
    let k = ph.map(|ph| ph / scored.variance * scored.weight);
    for (row, k) in p.iter_mut().zip(k) {
        for (p, ph) in row.iter_mut().zip(ph) {
            *p -= k * ph;
        }
    }
    k
}

/// Takes a measurement of the altitude, by which it changes by `factor`, into a covariance; the gain.
#[inline]
pub(crate) fn update_by_altitude(p: &mut Covariance, factor: f64, scored: &Scored) -> State {
    let k = [0, 1, 2, 3].map(|i| p[i][0] * factor / scored.variance * scored.weight);
    let top = p[0];
    for (row, k) in p.iter_mut().zip(k) {
        for (p, top) in row.iter_mut().zip(top) {
            *p -= k * factor * top;
        }
    }
    k
}

//! Readings that a balance would show of a rig's airframe, as a table that `bench identify` reads.

use std::fmt::Write as _;

use anyhow::Result;
use bench_plant::balance::HeldAirframe;
use bench_rig::{GRAVITY_M_S2, Rig};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// What is read, and how well.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Throttles in the rig's unit.
    pub throttles: Vec<f64>,
    /// Altitudes, mm; empty: far from any surface, and not told.
    pub altitudes_mm: Vec<f64>,
    /// Battery levels: name, and minutes of hover drawn before.
    pub levels: Vec<(String, f64)>,
    /// Readings at each throttle.
    pub repeats: usize,
    /// What the balance carries at rest, g.
    pub hanging_g: f64,
    /// One sigma before rounding, g.
    pub noise_g: f64,
    /// Share of readings that are off by up to 5 g.
    pub outliers: f64,
    /// Decimals of the balance.
    pub decimals: usize,
    /// Seed of noise and outliers.
    pub seed: u64,
}

impl Plan {
    /// Rest, below the offset, and from a fifth of the weight to one and a half of it; both levels of the paper's figure 9.
    pub fn thrust(rig: &Rig) -> Self {
        let a = &rig.airframe;
        let min = a.sticks.min;
        let mut throttles = vec![min, min + 0.5 * (a.thrust.offset.value - min)];
        throttles.extend((0..9).map(|i| a.throttle_for((0.2 + 0.1625 * f64::from(i)) * a.weight_n())));
        Self {
            throttles: settable(&throttles, rig),
            altitudes_mm: Vec::new(),
            levels: vec![("full".to_owned(), 0.0), ("half".to_owned(), 3.0)],
            repeats: 3,
            hanging_g: 1000.0 * a.mass_kg.value + 6.4,
            noise_g: 0.08,
            outliers: 0.04,
            decimals: 1,
            seed: 1,
        }
    }

    /// Three throttles in the range of flight at altitudes around the ground effect, as in the paper's figure 10.
    pub fn ground(rig: &Rig) -> Self {
        let a = &rig.airframe;
        let throttles = [0.85, 1.0, 1.15].map(|ratio| a.throttle_for(ratio * a.weight_n()));
        let height_mm = 1000.0 * a.ground_effect.height_m.value;
        let altitudes = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.6, 2.4];
        Self {
            throttles: settable(&throttles, rig),
            altitudes_mm: altitudes.map(|share| (share * height_mm).round()).to_vec(),
            levels: vec![("full".to_owned(), 0.0)],
            repeats: 2,
            ..Self::thrust(rig)
        }
    }

    /// The readings as CSV. Each level is one battery, drawn on by the readings themselves.
    pub fn readings(&self, rig: &Rig) -> Result<String> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let suffix = rig.airframe.actuation.suffix();
        let mut out = format!("throttle_{suffix},");
        out.push_str(if self.altitudes_mm.is_empty() {
            "reading_g,battery\n"
        } else {
            "altitude_mm,reading_g,battery\n"
        });
        for (name, minutes) in &self.levels {
            let mut airframe = HeldAirframe::new(rig, self.seed)?;
            airframe.hover(*minutes);
            let mut row = |throttle: f64, altitude_mm: Option<f64>, airframe: &mut HeldAirframe| {
                let height_m = altitude_mm.map_or(FAR_M, |mm| 0.001 * mm);
                let thrust_g = airframe.thrust_n(throttle, height_m) * 1000.0 / GRAVITY_M_S2;
                let noise: f64 = rng.sample(StandardNormal);
                let mut shown = self.hanging_g - thrust_g + self.noise_g * noise;
                let (off, much): (f64, f64) = (rng.random(), rng.random());
                if off < self.outliers {
                    // Something leans on the rig, or it swings.
                    shown += 10.0 * much - 5.0;
                }
                let _ = write!(out, "{throttle},");
                if let Some(mm) = altitude_mm {
                    let _ = write!(out, "{mm},");
                }
                let _ = writeln!(out, "{shown:.*},{name}", self.decimals);
            };
            if let Some(highest) = self.altitudes_mm.iter().copied().reduce(f64::max) {
                for _ in 0..3 * self.repeats {
                    row(rig.airframe.sticks.min, Some(highest), &mut airframe);
                }
            }
            for throttle in &self.throttles {
                let altitudes: Vec<Option<f64>> = match self.altitudes_mm.as_slice() {
                    [] => vec![None],
                    all => all.iter().copied().map(Some).collect(),
                };
                for altitude_mm in altitudes {
                    for _ in 0..self.repeats {
                        row(*throttle, altitude_mm, &mut airframe);
                    }
                }
            }
        }
        Ok(out)
    }
}

/// Far from any surface, m.
const FAR_M: f64 = 10.0;

/// Within the sticks' range and to a thousandth of it, as somebody would set it.
fn settable(throttles: &[f64], rig: &Rig) -> Vec<f64> {
    let (min, max) = (rig.airframe.sticks.min, rig.airframe.sticks.max);
    let step = 10_f64.powf((1e-3 * (max - min)).log10().ceil());
    let round = |u: f64| ((u / step).round() * step * 1e6).round() / 1e6;
    let mut out: Vec<f64> = throttles.iter().map(|u| round(u.clamp(min, max))).collect();
    out.retain(|u| (min..=max).contains(u));
    out.dedup();
    out
}

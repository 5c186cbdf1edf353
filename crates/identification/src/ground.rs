//! Boundary and multiplier of the ground effect from thrust at static altitudes (paper, section 3.4, figure 10).

use bench_rig::{EffectEntry, GRAVITY_M_S2, Location, Rig, Uncertain};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::{
    error::IdentifyError,
    readings::{Mounting, Readings, Refused},
    statistics::{MOST_REFUSED, REFUSED_SIGMAS, Spread, f_tail, half_width_95, median, robust_sigma},
    thrust::ThrustOptions,
};

/// What readings of thrust over altitude tell. As JSON it is `bench.identification.ground-effect/1`
/// (docs/model-development.md).
#[derive(Clone, Debug, Serialize)]
pub struct GroundIdentification {
    /// `bench.identification.ground-effect/1`.
    pub schema: &'static str,
    /// Multiplier at the ground (1) and boundary (m) of the linear law.
    pub numbers: [GroundNumber; 2],
    /// The laws that were compared, the most likely first.
    pub laws: Vec<LawTold>,
    /// Thrust at each throttle.
    pub throttles: Vec<ThrottleTold>,
    /// Probability that multipliers differ so much from throttle to throttle if they were one.
    pub throttles_differ_p: Option<f64>,
    /// One sigma of a reading, rounding included, N.
    pub reading_sigma_n: f64,
    /// The balance's step, N.
    pub resolution_n: f64,
    /// Every reading above rest, as thrust.
    pub points: Vec<GroundPoint>,
    /// What is not used, and why.
    pub refused: Vec<Refused>,
    /// What should be known.
    pub warnings: Vec<String>,
    /// The rig with the numbers found.
    #[serde(skip)]
    pub rig: Rig,
}

/// A number of the linear law.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GroundNumber {
    /// Which.
    pub name: &'static str,
    /// Value and one sigma that the rig gave.
    pub before: (f64, f64),
    /// Value and one sigma of the new rig.
    pub after: (f64, f64),
    /// Where it lies with 95 %.
    pub interval_95: [f64; 2],
}

/// How thrust over free thrust falls with altitude. Each is one at infinity and the multiplier at the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// `1 + (m - 1) max(0, 1 - z/l)`, the paper's (section 3.3).
    Linear,
    /// `1 + (m - 1) exp(-z/l)` (He et al., Journal of Dynamic Systems, Measurement, and Control 141(7), 2019).
    Exponential,
    /// `1/(1 - (R/4(z + l))^2)`, a rotor of radius `R` at `l` above what altitude is counted from (Cheeseman and Bennett, ARC
    /// R&M 3021, 1955); `R = 4 l sqrt(1 - 1/m)`.
    CheesemanBennett,
}

impl Law {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Exponential, Self::CheesemanBennett];

    /// Its name in words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Exponential => "exponential",
            Self::CheesemanBennett => "Cheeseman-Bennett",
        }
    }

    /// Thrust over free thrust at an altitude, m, for a multiplier at the ground and a length, m.
    pub fn ratio(self, z_m: f64, multiplier: f64, length_m: f64) -> f64 {
        let z = z_m.max(0.0);
        match self {
            Self::Linear => 1.0 + (multiplier - 1.0) * (1.0 - z / length_m).max(0.0),
            Self::Exponential => 1.0 + (multiplier - 1.0) * (-z / length_m).exp(),
            Self::CheesemanBennett => {
                let share = 1.0 - multiplier.max(1e-3).recip();
                (1.0 - share * (length_m / (z + length_m)).powi(2)).recip()
            }
        }
    }
}

/// A law as fitted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LawTold {
    /// Which.
    pub law: Law,
    /// Its probability, the three being as likely before.
    pub probability: f64,
    /// Natural logarithm of its evidence over the linear law's.
    pub nats: f64,
    /// Multiplier at the ground and its standard error.
    pub multiplier: (f64, f64),
    /// Length `l` of the law, m, and its standard error.
    pub length_m: (f64, f64),
    /// Cheeseman and Bennett's rotor radius, m.
    pub rotor_radius_m: Option<f64>,
    /// RMS of what it leaves, N.
    pub rms_n: f64,
}

/// One throttle of the readings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ThrottleTold {
    /// In the rig's unit.
    pub throttle: f64,
    /// Battery level as the file names it.
    pub level: String,
    /// Thrust far from the ground, N, and its standard error.
    pub free_thrust_n: (f64, f64),
    /// What the rig's gain and offset give there, N.
    pub rig_thrust_n: f64,
    /// The multiplier of this throttle alone, boundary as common, and its standard error.
    pub multiplier: (f64, f64),
    /// Readings used.
    pub readings: usize,
}

/// A reading as thrust.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GroundPoint {
    /// Line in the file.
    pub line: u64,
    /// Index into the throttles.
    pub throttle: usize,
    /// m.
    pub altitude_m: f64,
    /// Weight taken off, N.
    pub thrust_n: f64,
    /// Whether the laws were fitted to it.
    pub used: bool,
}

/// Fewest readings.
const LEAST_READINGS: usize = 8;
/// Fewest altitudes.
const LEAST_ALTITUDES: usize = 4;
/// Lengths that are tried to begin with, over the highest altitude, and how many.
const LENGTHS: (f64, f64, usize) = (0.02, 1.5, 24);
/// Multipliers less one that are tried to begin with.
const EXTRAS: [f64; 10] = [-0.3, -0.1, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.5];
/// Steps by which the start is narrowed down end below this, of the multiplier and of the length's logarithm.
const NEAR_ENOUGH: f64 = 0.003;
/// Steps of the start at most.
const STEPS: usize = 60;
/// Rounds of fitting and finding the scatter.
const FITS: usize = 2;
/// The length is searched in steps of so many of its deviations, four to each side, one after another.
const SEARCH: [f64; 4] = [0.6, 0.15, 0.04, 0.01];
/// Steps for the multiplier at a length.
const INNER: usize = 5;
const ROUNDS: usize = 20;
/// The multiplier must be so many standard errors above one.
const PLAIN_SIGMAS: f64 = 3.0;
/// The rig's ground effect may end so many times higher or lower.
const FAR: f64 = 100.0;
/// Steepest form that `ground-effect-shape` takes: an exponential for all purposes.
const EXPONENT: f64 = 50.0;

/// A reading: which throttle, where, and its thrust.
#[derive(Clone, Copy)]
struct Row {
    line: u64,
    setting: usize,
    altitude_m: f64,
    thrust_n: f64,
    used: bool,
}

/// Repeats of one setting at one altitude.
#[derive(Clone, Copy)]
struct Cell {
    setting: usize,
    altitude_m: f64,
    mean: f64,
    count: usize,
}

/// A law fitted to cells: multiplier, logarithm of the length, and free thrust of each setting.
struct Fit {
    law: Law,
    x: DVector<f64>,
    covariance: DMatrix<f64>,
    spread: Spread,
    degrees: f64,
    squares: f64,
    readings: usize,
}

/// Fits the ground effect to readings of thrust at static altitudes, each throttle with a free thrust of its own. The rig gets
/// the linear law; `with_shape` adds the effect `ground-effect-shape` to it where the readings prefer the exponential.
pub fn identify_ground_effect(
    readings: &Readings,
    rig: &Rig,
    options: &ThrustOptions,
    with_shape: bool,
) -> Result<GroundIdentification, IdentifyError> {
    let mut fitter = Fitter::new(readings, rig, options)?;
    let (best, fits) = fitter.fit_all()?;
    fitter.tell(best, &fits, readings, rig, with_shape)
}

struct Fitter {
    rows: Vec<Row>,
    /// Throttle and level.
    settings: Vec<(f64, usize)>,
    refused: Vec<Refused>,
    step: f64,
    highest_m: f64,
    /// Of what is taken off for the weight, N^2.
    zero_variance: f64,
}

/// Mean of readings at rest without those far off, and its variance.
fn mean_at_rest(shown: &[f64], step: f64) -> Option<(f64, f64)> {
    let middle = median(shown);
    let off: Vec<f64> = shown.iter().map(|y| y - middle).collect();
    let sigma = robust_sigma(&off, 1).max(step / 12_f64.sqrt());
    let kept: Vec<f64> =
        shown.iter().copied().filter(|y| (y - middle).abs() <= REFUSED_SIGMAS * sigma).collect();
    let n = kept.len() as f64;
    let mean = kept.iter().sum::<f64>() / n;
    let squares: f64 = kept.iter().map(|y| (y - mean).powi(2)).sum();
    let spread = Spread::new(squares / (n - 1.0).max(1.0), step);
    (!kept.is_empty()).then(|| (mean, spread.of_mean(kept.len())))
}

impl Fitter {
    fn new(readings: &Readings, rig: &Rig, options: &ThrustOptions) -> Result<Self, IdentifyError> {
        let table =
            |detail: &str| IdentifyError::Table { file: readings.file.clone(), detail: detail.to_owned() };
        let mounting = if readings.is_thrust { Mounting::Pressing } else { options.mounting };
        let step = options.resolution_n.unwrap_or(readings.resolution_n);
        if readings.rows.iter().all(|row| row.altitude_m.is_none()) {
            return Err(table("no column `altitude_m`, `altitude_cm` or `altitude_mm` with values"));
        }
        // At rest, and surely below where thrust begins: what the balance carries.
        let thrust = &rig.airframe.thrust;
        let surely = thrust.offset.value - 3.0 * thrust.offset.sigma;
        let turns = |throttle: f64| throttle > rig.airframe.sticks.min && throttle > surely;
        let sign = mounting.sign();
        let at_rest: Vec<Option<(f64, f64)>> = (0..readings.levels.len())
            .map(|level| {
                let own = readings.rows.iter().filter(|row| row.level == level && !turns(row.throttle));
                mean_at_rest(&own.map(|row| sign * row.shown_n).collect::<Vec<_>>(), step)
            })
            .collect();
        let rounding = step * step / 12.0;
        let given = match (options.hanging_n, mounting) {
            (Some(hanging_n), Mounting::Suspended) => Some((-hanging_n, rounding)),
            (None, Mounting::Suspended) => None,
            (_, Mounting::Tared | Mounting::Pressing) => Some((0.0, rounding)),
        };
        let shared = at_rest.iter().flatten().next().copied();
        let zeros: Vec<Option<(f64, f64)>> = at_rest.iter().map(|own| own.or(given).or(shared)).collect();
        let variances = || zeros.iter().flatten().map(|(_, variance)| *variance);
        let mut out = Self {
            rows: Vec::new(),
            settings: Vec::new(),
            refused: readings.refused.clone(),
            step,
            highest_m: 0.0,
            zero_variance: variances().sum::<f64>() / variances().count().max(1) as f64,
        };
        for row in &readings.rows {
            let (zero, _) =
                zeros[row.level].ok_or(IdentifyError::NoRest { rest: rig.airframe.sticks.min })?;
            let thrust_n = sign * row.shown_n - zero;
            let mut refuse = |why: &str| {
                out.refused.push(Refused {
                    line: row.line,
                    throttle: Some(row.throttle),
                    thrust_n: Some(thrust_n),
                    why: why.to_owned(),
                });
            };
            if !turns(row.throttle) {
                refuse("rotors at rest: used for the weight alone");
                continue;
            }
            let Some(altitude_m) = row.altitude_m else {
                refuse("no altitude");
                continue;
            };
            if altitude_m < 0.0 {
                refuse("below the surface");
                continue;
            }
            let key = (row.throttle, row.level);
            let setting = out.settings.iter().position(|known| *known == key).unwrap_or_else(|| {
                out.settings.push(key);
                out.settings.len() - 1
            });
            out.highest_m = out.highest_m.max(altitude_m);
            out.rows.push(Row { line: row.line, setting, altitude_m, thrust_n, used: true });
        }
        out.drop_lone_settings(readings);
        out.check(readings, rig)?;
        Ok(out)
    }

    /// A throttle at one altitude alone tells nothing of the ground.
    fn drop_lone_settings(&mut self, readings: &Readings) {
        let altitudes = |setting: usize| {
            let mut all: Vec<f64> =
                self.rows.iter().filter(|row| row.setting == setting).map(|row| row.altitude_m).collect();
            all.sort_by(f64::total_cmp);
            all.dedup();
            all.len()
        };
        let kept: Vec<usize> = (0..self.settings.len()).filter(|setting| altitudes(*setting) > 1).collect();
        let (rows, lone): (Vec<Row>, Vec<Row>) =
            self.rows.iter().partition(|row| kept.contains(&row.setting));
        self.refused.extend(lone.iter().map(|row| {
            let (throttle, level) = self.settings[row.setting];
            Refused {
                line: row.line,
                throttle: Some(throttle),
                thrust_n: Some(row.thrust_n),
                why: match readings.levels[level].as_str() {
                    "" => "this throttle was read at one altitude alone".to_owned(),
                    name => format!("this throttle was read at one altitude alone at battery level {name:?}"),
                },
            }
        }));
        self.settings = kept.iter().map(|setting| self.settings[*setting]).collect();
        self.rows = rows
            .into_iter()
            .filter_map(|row| {
                let setting = kept.iter().position(|kept| *kept == row.setting)?;
                Some(Row { setting, ..row })
            })
            .collect();
    }

    fn check(&self, readings: &Readings, rig: &Rig) -> Result<(), IdentifyError> {
        let mut altitudes: Vec<f64> = self.rows.iter().map(|row| row.altitude_m).collect();
        altitudes.sort_by(f64::total_cmp);
        altitudes.dedup();
        if self.rows.len() < LEAST_READINGS || altitudes.len() < LEAST_ALTITUDES {
            return Err(IdentifyError::TooFewAltitudes {
                usable: self.rows.len(),
                altitudes: altitudes.len(),
                least: LEAST_READINGS,
            });
        }
        let boundary_m = rig.airframe.ground_effect.height_m.value;
        let of_boundary = self.highest_m / boundary_m;
        let hint = match of_boundary {
            x if x > FAR => "1000 times too high, as millimetres taken for metres?",
            x if x < FAR.recip() => "1000 times too low, as metres taken for millimetres?",
            _ => "",
        };
        if !hint.is_empty() {
            let (highest_m, unit) = (self.highest_m, readings.altitude_unit);
            return Err(IdentifyError::AltitudeScale { highest_m, boundary_m, hint, unit });
        }
        let thrusts: Vec<f64> = self.rows.iter().map(|row| row.thrust_n).collect();
        let ratio = median(&thrusts) / rig.airframe.weight_n();
        if !(0.05..20.0).contains(&ratio) {
            let hint = match ratio.abs() {
                _ if ratio < -0.05 => {
                    ": it is negative; do the readings grow with thrust? Then give --mounting pressing"
                }
                x if (300.0..5000.0).contains(&x) => {
                    ": about 1000 times too much, as milligrams taken for grams"
                }
                x if (30.0..300.0).contains(&x) => ": about 100 times too much, as grams taken for newtons",
                x if (0.003..0.03).contains(&x) => ": about 100 times too little, as newtons taken for grams",
                x if (0.0002..0.003).contains(&x) => {
                    ": about 1000 times too little, as kilograms taken for grams"
                }
                _ => "",
            };
            let weight_g = 1000.0 * rig.airframe.mass_kg.value;
            return Err(IdentifyError::ForceScale { ratio, weight_g, hint });
        }
        Ok(())
    }

    fn cells(&self) -> Vec<Cell> {
        let mut rows: Vec<&Row> = self.rows.iter().filter(|row| row.used).collect();
        rows.sort_by(|a, b| a.setting.cmp(&b.setting).then(a.altitude_m.total_cmp(&b.altitude_m)));
        rows.chunk_by(|a, b| a.setting == b.setting && a.altitude_m == b.altitude_m)
            .map(|rows| Cell {
                setting: rows[0].setting,
                altitude_m: rows[0].altitude_m,
                mean: rows.iter().map(|row| row.thrust_n).sum::<f64>() / rows.len() as f64,
                count: rows.len(),
            })
            .collect()
    }

    /// Sum of sizes of residuals of a law, its free thrusts by medians: outliers do not move it much.
    fn cost(&self, law: Law, multiplier: f64, ln_length: f64) -> (f64, DVector<f64>) {
        let mut x = DVector::zeros(2 + self.settings.len());
        x[0] = multiplier;
        x[1] = ln_length;
        let mut cost = 0.0;
        for setting in 0..self.settings.len() {
            let own: Vec<(f64, f64)> = self
                .rows
                .iter()
                .filter(|row| row.setting == setting)
                .map(|row| (row.thrust_n, law.ratio(row.altitude_m, multiplier, ln_length.exp())))
                .collect();
            let free = median(&own.iter().map(|(thrust, ratio)| thrust / ratio).collect::<Vec<_>>());
            x[2 + setting] = free;
            cost += own.iter().map(|(thrust, ratio)| (thrust - free * ratio).abs()).sum::<f64>();
        }
        (cost, x)
    }

    /// The least of these sums, on a grid and then nearer and nearer to it.
    fn start(&self, law: Law) -> (f64, DVector<f64>) {
        let (from, to, count) = LENGTHS;
        let lengths = (0..count)
            .map(|i| (self.highest_m * from).ln() + (to / from).ln() * i as f64 / (count - 1) as f64);
        let mut best = (f64::INFINITY, DVector::zeros(2 + self.settings.len()));
        for ln_length in lengths {
            for extra in EXTRAS {
                let tried = self.cost(law, 1.0 + extra, ln_length);
                if tried.0 < best.0 {
                    best = tried;
                }
            }
        }
        let reach = (self.highest_m * 0.5 * from).ln()..=(self.highest_m * 2.0 * to).ln();
        let mut step = 0.1;
        for _ in 0..STEPS {
            if step < NEAR_ENOUGH {
                break;
            }
            let (m, ln_length) = (best.1[0], best.1[1]);
            let around = [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step), (step, -step), (-step, step)];
            let nearest = around
                .into_iter()
                .filter(|(_, dl)| reach.contains(&(ln_length + dl)))
                .map(|(dm, dl)| self.cost(law, (m + dm).clamp(0.05, 20.0), ln_length + dl))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|tried| tried.0 < best.0);
            match nearest {
                Some(tried) => best = tried,
                None => step *= 0.5,
            }
        }
        best
    }

    /// Fits the laws to the readings that the best of them does not refuse.
    fn fit_all(&mut self) -> Result<(usize, Vec<Fit>), IdentifyError> {
        let starts: Vec<(f64, DVector<f64>)> = Law::ALL.iter().map(|law| self.start(*law)).collect();
        let mut best = (0..Law::ALL.len()).min_by(|a, b| starts[*a].0.total_cmp(&starts[*b].0)).unwrap_or(0);
        let parameters = 2 + self.settings.len();
        let mut residuals = self.residuals(Law::ALL[best], &starts[best].1);
        let mut sigma = robust_sigma(&residuals, parameters).max(self.step / 12_f64.sqrt());
        let mut fits = Vec::new();
        for _ in 0..ROUNDS {
            let before: Vec<bool> = self.rows.iter().map(|row| row.used).collect();
            for (row, residual) in self.rows.iter_mut().zip(&residuals) {
                row.used = residual.abs() <= REFUSED_SIGMAS * sigma;
            }
            let refused = self.rows.iter().filter(|row| !row.used).count();
            if refused as f64 > MOST_REFUSED * self.rows.len() as f64 {
                let first = self.rows.iter().find(|row| !row.used);
                return Err(IdentifyError::Scattered {
                    refused,
                    all: self.rows.len(),
                    law: "law of altitude",
                    first: first.map_or_else(String::new, |row| format!(", first in line {}", row.line)),
                });
            }
            let settled = !fits.is_empty() && before.iter().zip(&self.rows).all(|(b, row)| *b == row.used);
            if settled {
                break;
            }
            let cells = self.cells();
            fits = Law::ALL
                .iter()
                .zip(&starts)
                .map(|(law, (_, start))| self.fit(*law, start.clone(), &cells))
                .collect();
            best = (0..fits.len()).min_by(|a, b| fits[*a].squares.total_cmp(&fits[*b].squares)).unwrap_or(0);
            residuals = self.residuals(fits[best].law, &fits[best].x);
            sigma = fits[best].spread.variance.sqrt();
        }
        Ok((best, fits))
    }

    fn residuals(&self, law: Law, x: &DVector<f64>) -> Vec<f64> {
        self.rows
            .iter()
            .map(|row| row.thrust_n - x[2 + row.setting] * law.ratio(row.altitude_m, x[0], x[1].exp()))
            .collect()
    }

    /// Weighted least squares. The linear law's boundary bends the sum of squares at each altitude that was read, so the length is
    /// searched, all else solved for at each.
    fn fit(&self, law: Law, mut x: DVector<f64>, cells: &[Cell]) -> Fit {
        let n = x.len();
        let mut spread = Spread::new(0.0, self.step);
        let mut covariance = DMatrix::zeros(n, n);
        let (mut squares, mut readings) = (0.0, 0_usize);
        for _ in 0..FITS {
            let known = Self::normal(law, &x, cells, spread).try_inverse();
            let sigma = known.map_or(0.1, |c| c[(1, 1)].max(0.0).sqrt()).clamp(0.005, 0.3);
            let mut best = self.at_length(law, x[1], x[0], cells, spread);
            for step in SEARCH {
                let middle = best.1[1];
                for k in [-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0] {
                    let tried = self.at_length(law, middle + k * step * sigma, best.1[0], cells, spread);
                    if tried.0 < best.0 {
                        best = tried;
                    }
                }
            }
            x = best.1;
            let own = self.residuals(law, &x);
            let used = self.rows.iter().zip(&own).filter(|(row, _)| row.used);
            (squares, readings) = used.fold((0.0, 0), |(sum, n), (_, r)| (sum + r * r, n + 1));
            spread = Spread::new(squares / readings.saturating_sub(n).max(1) as f64, self.step);
            covariance =
                Self::normal(law, &x, cells, spread).try_inverse().unwrap_or_else(|| DMatrix::zeros(n, n));
        }
        // What hangs there is known to its own error, which moves all thrusts alike.
        let free = x.rows(2, n - 2).sum() / (n - 2) as f64;
        let mut shift = DVector::from_element(n, 1.0);
        shift[0] = -(x[0] - 1.0) / free;
        shift[1] = 0.0;
        covariance += self.zero_variance * &shift * shift.transpose();
        let degrees = spread.degrees(readings, cells.len(), n);
        Fit { law, x, covariance, spread, degrees, squares, readings }
    }

    /// The least sum of squares for a length, over multiplier and free thrusts: Gauss and Newton's steps of the multiplier, free
    /// thrusts projected out (Golub and Pereyra, SIAM Journal on Numerical Analysis 10(2), 1973).
    fn at_length(
        &self,
        law: Law,
        ln_length: f64,
        multiplier: f64,
        cells: &[Cell],
        spread: Spread,
    ) -> (f64, DVector<f64>) {
        let length = ln_length.exp();
        let settings = self.settings.len();
        let mut m = multiplier;
        let mut x = DVector::zeros(2 + settings);
        let mut cost = f64::INFINITY;
        for _ in 0..INNER {
            let mut sums = vec![[0.0; 4]; settings];
            let at: Vec<(f64, f64, f64)> = cells
                .iter()
                .map(|cell| {
                    let ratio = law.ratio(cell.altitude_m, m, length);
                    let slope = (law.ratio(cell.altitude_m, m + 1e-5, length) - ratio) * 1e5;
                    let weight = spread.of_mean(cell.count).recip();
                    let sum = &mut sums[cell.setting];
                    sum[0] += weight * ratio * ratio;
                    sum[1] += weight * ratio * cell.mean;
                    sum[2] += weight * ratio * slope;
                    (ratio, slope, weight)
                })
                .collect();
            cost = 0.0;
            let (mut gradient, mut information) = (0.0, 0.0);
            for (cell, (ratio, slope, weight)) in cells.iter().zip(at) {
                let [gg, gy, gd, _] = sums[cell.setting];
                let free = gy / gg;
                x[2 + cell.setting] = free;
                let residual = cell.mean - free * ratio;
                let pull = free * (slope - gd / gg * ratio);
                cost += weight * residual * residual;
                gradient += weight * pull * residual;
                information += weight * pull * pull;
            }
            x[0] = m;
            x[1] = ln_length;
            if information <= 0.0 {
                break;
            }
            let step = gradient / information;
            if step.abs() < 1e-7 {
                break;
            }
            m = (m + step.clamp(-0.5, 0.5)).clamp(0.05, 20.0);
        }
        (cost, x)
    }

    /// Fisher information of multiplier, logarithm of the length and free thrusts.
    fn normal(law: Law, x: &DVector<f64>, cells: &[Cell], spread: Spread) -> DMatrix<f64> {
        let n = x.len();
        let mut normal = DMatrix::zeros(n, n);
        for cell in cells {
            let at = |m: f64, ln_length: f64| law.ratio(cell.altitude_m, m, ln_length.exp());
            let free = x[2 + cell.setting];
            let ratio = at(x[0], x[1]);
            let h = 1e-5;
            let slopes = [
                (0, free * (at(x[0] + h, x[1]) - at(x[0] - h, x[1])) / (2.0 * h)),
                (1, free * (at(x[0], x[1] + h) - at(x[0], x[1] - h)) / (2.0 * h)),
                (2 + cell.setting, ratio),
            ];
            let weight = spread.of_mean(cell.count).recip();
            for (i, a) in slopes {
                for (j, b) in slopes {
                    normal[(i, j)] += weight * a * b;
                }
            }
        }
        normal
    }
}

impl Fit {
    fn sigma(&self, i: usize) -> f64 {
        self.covariance[(i, i)].max(0.0).sqrt()
    }

    fn length_m(&self) -> (f64, f64) {
        let length = self.x[1].exp();
        (length, length * self.sigma(1))
    }

    /// Natural logarithm of the evidence, but for what all laws share: the scatter is not known, and all have as many numbers
    /// (Schwarz, Estimating the dimension of a model, Annals of Statistics 6(2), 1978).
    fn log_evidence(&self, floor: f64) -> f64 {
        let n = self.readings.max(1) as f64;
        -0.5 * n * (self.squares / n).max(floor).ln()
    }
}

impl Fitter {
    fn tell(
        self,
        best: usize,
        fits: &[Fit],
        readings: &Readings,
        rig: &Rig,
        with_shape: bool,
    ) -> Result<GroundIdentification, IdentifyError> {
        let linear = &fits[0];
        let (ratio, sigma) = (linear.x[0], linear.sigma(0));
        if ratio - 1.0 < PLAIN_SIGMAS * sigma.max(1e-6) {
            let falls = (1.0 - ratio) * linear.x[2].abs() > PLAIN_SIGMAS * linear.spread.variance.sqrt();
            let hint = if falls {
                ", it falls towards it; is altitude counted downwards, or do the readings fall with thrust (--mounting)?"
            } else {
                "; are the altitudes above the effect, or is the column another one?"
            };
            return Err(IdentifyError::NoGroundEffect { ratio, hint });
        }
        let lowest =
            self.rows.iter().filter(|row| row.used).map(|row| row.altitude_m).fold(f64::MAX, f64::min);
        let length = linear.length_m().0;
        if lowest > 0.5 * length {
            // What the lowest reading has of it, not what a line through it would reach at the ground.
            let ratio = Law::Linear.ratio(lowest, ratio, length);
            let hint = " at the lowest reading; are all altitudes above the effect?";
            return Err(IdentifyError::NoGroundEffect { ratio, hint });
        }
        if ratio > 3.0 {
            return Err(IdentifyError::OutOfRange {
                name: "the multiplier",
                value: ratio,
                range: "1 to 3",
                advice: "add readings nearer to the ground and far from it",
            });
        }
        let floor = self.step * self.step / 12.0;
        let evidence: Vec<f64> = fits.iter().map(|fit| fit.log_evidence(floor)).collect();
        let most = evidence.iter().copied().fold(f64::MIN, f64::max);
        let total: f64 = evidence.iter().map(|ln| (ln - most).exp()).sum();
        let mut laws: Vec<LawTold> = fits
            .iter()
            .zip(&evidence)
            .map(|(fit, ln)| LawTold {
                law: fit.law,
                probability: (ln - most).exp() / total,
                nats: ln - evidence[0],
                multiplier: (fit.x[0], fit.sigma(0)),
                length_m: fit.length_m(),
                rotor_radius_m: (fit.law == Law::CheesemanBennett)
                    .then(|| 4.0 * fit.length_m().0 * (1.0 - fit.x[0].recip()).max(0.0).sqrt()),
                rms_n: (fit.squares / fit.readings.max(1) as f64).sqrt(),
            })
            .collect();
        laws.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let half = half_width_95(linear.degrees);
        let before = rig.airframe.ground_effect;
        let (height, height_sigma) = linear.length_m();
        let number = |name, before: Uncertain, value: f64, sigma: f64| GroundNumber {
            name,
            before: (before.value, before.sigma),
            after: (value, sigma),
            interval_95: [value - half * sigma, value + half * sigma],
        };
        let numbers = [
            number("ground_effect_multiplier", before.multiplier, ratio, sigma),
            number("ground_effect_height_m", before.height_m, height, height_sigma),
        ];
        let (throttles, throttles_differ_p) = self.throttles(linear, readings, rig);
        let mut out = rig.clone();
        out.airframe.ground_effect.multiplier = Uncertain { value: ratio, sigma };
        out.airframe.ground_effect.height_m = Uncertain { value: height, sigma: height_sigma };
        let mut warnings = self.warnings(linear, &laws, &throttles, with_shape);
        if with_shape && laws[0].law != Law::Linear {
            shape(&mut out, &fits[1], &mut warnings);
        }
        let scatter = fits[best].spread.variance.sqrt();
        let resolution_n = self.step;
        let (points, refused) = self.sorted(&fits[best]);
        Ok(GroundIdentification {
            schema: "bench.identification.ground-effect/1",
            numbers,
            laws,
            throttles,
            throttles_differ_p,
            reading_sigma_n: scatter,
            resolution_n,
            points,
            refused,
            warnings,
            rig: out,
        })
    }

    /// The readings as thrust, and those that are not used.
    fn sorted(mut self, best: &Fit) -> (Vec<GroundPoint>, Vec<Refused>) {
        let point = |row: &Row| GroundPoint {
            line: row.line,
            throttle: row.setting,
            altitude_m: row.altitude_m,
            thrust_n: row.thrust_n,
            used: row.used,
        };
        let points = self.rows.iter().map(point).collect();
        let off = self.residuals(best.law, &best.x);
        let scatter = best.spread.variance.sqrt();
        let mut refused = std::mem::take(&mut self.refused);
        refused.extend(self.rows.iter().zip(off).filter(|(row, _)| !row.used).map(|(row, off)| Refused {
            line: row.line,
            throttle: Some(self.settings[row.setting].0),
            thrust_n: Some(row.thrust_n),
            why: format!(
                "off the {} law by {:+.2} g, {:.0} sigma",
                best.law.name(),
                off * 1000.0 / GRAVITY_M_S2,
                off.abs() / scatter
            ),
        }));
        refused.sort_by_key(|refused| refused.line);
        (points, refused)
    }

    /// Each throttle's own multiplier, the boundary as common.
    fn throttles(&self, fit: &Fit, readings: &Readings, rig: &Rig) -> (Vec<ThrottleTold>, Option<f64>) {
        let length = fit.length_m().0;
        let cells = self.cells();
        let told: Vec<ThrottleTold> = self
            .settings
            .iter()
            .enumerate()
            .map(|(setting, (throttle, level))| {
                // T = a + b depth: the multiplier is 1 + b/a.
                let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
                for cell in cells.iter().filter(|cell| cell.setting == setting) {
                    let row = nalgebra::Vector2::new(1.0, (1.0 - cell.altitude_m / length).max(0.0));
                    let weight = fit.spread.of_mean(cell.count).recip();
                    normal += weight * row * row.transpose();
                    right += weight * cell.mean * row;
                }
                let multiplier = normal.try_inverse().map_or((f64::NAN, f64::INFINITY), |covariance| {
                    let x: nalgebra::Vector2<f64> = covariance * right;
                    let slopes = nalgebra::Vector2::new(-x[1] / (x[0] * x[0]), x[0].recip());
                    (1.0 + x[1] / x[0], (slopes.transpose() * covariance * slopes)[(0, 0)].max(0.0).sqrt())
                });
                ThrottleTold {
                    throttle: *throttle,
                    level: readings.levels[*level].clone(),
                    free_thrust_n: (fit.x[2 + setting], fit.sigma(2 + setting)),
                    rig_thrust_n: rig.airframe.thrust_n(*throttle),
                    multiplier,
                    readings: self.rows.iter().filter(|row| row.used && row.setting == setting).count(),
                }
            })
            .collect();
        let sound: Vec<(f64, f64)> = told
            .iter()
            .map(|t| t.multiplier)
            .filter(|(m, s)| m.is_finite() && s.is_finite() && *s > 0.0)
            .collect();
        let p = (sound.len() > 1).then(|| {
            let weights: f64 = sound.iter().map(|(_, s)| s.powi(-2)).sum();
            let mean = sound.iter().map(|(m, s)| m * s.powi(-2)).sum::<f64>() / weights;
            let chi: f64 = sound.iter().map(|(m, s)| ((m - mean) / s).powi(2)).sum();
            let degrees = sound.len() as f64 - 1.0;
            f_tail(chi / degrees, degrees, fit.degrees)
        });
        (told, p)
    }

    fn warnings(
        &self,
        linear: &Fit,
        laws: &[LawTold],
        throttles: &[ThrottleTold],
        with_shape: bool,
    ) -> Vec<String> {
        let mut warnings = Vec::new();
        let best = &laws[0];
        if best.law != Law::Linear && best.nats > 3.0 {
            let more = if with_shape { "" } else { "; --with-shape adds what the rig can say of it" };
            warnings.push(format!(
                "the readings prefer the {} law to the linear one by {:.1} nats{more}",
                best.law.name(),
                best.nats
            ));
        }
        let height = linear.length_m().0;
        let above = self.rows.iter().filter(|row| row.used && row.altitude_m > height).count();
        if above == 0 {
            warnings.push(format!(
                "no reading is above the boundary of {:.1} cm: free thrust is extrapolated",
                100.0 * height
            ));
        }
        for told in throttles {
            let (free, sigma) = told.free_thrust_n;
            let off = free / told.rig_thrust_n - 1.0;
            if told.rig_thrust_n > 0.0 && off.abs() > 0.05_f64.max(4.0 * sigma / free) {
                warnings.push(format!(
                    "far from the ground throttle {} gives {:.1} g, while the rig's gain and offset give {:.1} g: identify the thrust first, or another battery level",
                    told.throttle,
                    free * 1000.0 / GRAVITY_M_S2,
                    told.rig_thrust_n * 1000.0 / GRAVITY_M_S2
                ));
            }
        }
        warnings
    }
}

/// Adds the exponential law to a rig as the effect `ground-effect-shape`, with its own multiplier.
fn shape(rig: &mut Rig, exponential: &Fit, warnings: &mut Vec<String>) {
    let (length, sigma) = exponential.length_m();
    let ground = &mut rig.airframe.ground_effect;
    let multiplier = Uncertain { value: exponential.x[0], sigma: exponential.sigma(0) };
    let stretch = length / ground.height_m.value;
    if !(1.0..=3.0).contains(&multiplier.value) || !(0.1..=10.0).contains(&stretch) {
        warnings.push(
            "the exponential law found is beyond what the effect ground-effect-shape takes; not added".into(),
        );
        return;
    }
    ground.multiplier = multiplier;
    // The tolerance of the length, as the effect multiplies the height.
    ground.height_m.sigma = sigma / stretch;
    rig.effects.retain(|effect| effect.name != "ground-effect-shape");
    rig.effects.push(EffectEntry {
        name: "ground-effect-shape".to_owned(),
        parameters: vec![("stretch".to_owned(), stretch, 0), ("exponent".to_owned(), EXPONENT, 0)],
        at: Location::default(),
    });
}

//! Gain and offset from throttle and thrust on a balance (paper, section 3.4, figure 9).

use bench_rig::{GRAVITY_M_S2, Rig, Uncertain};
use bench_statistics::Sorted;
use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use crate::{
    error::IdentifyError,
    readings::{Mounting, Readings, Refused},
    statistics::{
        MOST_REFUSED, REFUSED_SIGMAS, Spread, f_tail, half_width_95, median, robust_sigma, two_sided_p,
    },
};

/// How the balance was used, and what of its readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThrustOptions {
    /// How thrust comes to the balance.
    pub mounting: Mounting,
    /// What the balance carries at rest, N, where no reading at rest tells.
    pub hanging_n: Option<f64>,
    /// The balance's step, N, where the digits of the readings do not tell.
    pub resolution_n: Option<f64>,
    /// Lowest throttle of the line.
    pub from: Option<f64>,
    /// Highest throttle of the line.
    pub to: Option<f64>,
}

/// What readings of throttle and thrust tell. As JSON it is `bench.identification.thrust/1` (docs/model-development.md).
#[derive(Clone, Debug, Serialize)]
pub struct ThrustIdentification {
    /// `bench.identification.thrust/1`.
    pub schema: &'static str,
    /// Unit of the throttle.
    pub throttle_unit: &'static str,
    /// Gain (N per unit), offset and the throttle that hovers (units).
    pub numbers: [Measured; 3],
    /// The line of each battery level.
    pub levels: Vec<LevelLine>,
    /// Whether the levels differ.
    pub levels_differ: Option<LevelsDiffer>,
    /// Whether it is a line.
    pub linearity: Linearity,
    /// One sigma of a reading, rounding included, N.
    pub reading_sigma_n: f64,
    /// The balance's step, N.
    pub resolution_n: f64,
    /// Every reading: what it was taken for.
    pub points: Vec<Point>,
    /// What is not used, and why.
    pub refused: Vec<Refused>,
    /// What should be known.
    pub warnings: Vec<String>,
    /// The rig with the numbers found.
    #[serde(skip)]
    pub rig: Rig,
}

/// A number from the balance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Which.
    pub name: &'static str,
    /// Value and one sigma that the rig gave.
    pub before: (f64, f64),
    /// Value and one sigma of the new rig: the standard error, what differs between levels and, for the throttle that hovers,
    /// what is not known of the mass.
    pub after: (f64, f64),
    /// One sigma of the mean over the levels, from the readings' scatter.
    pub standard_error: f64,
    /// Where that mean lies with 95 %.
    pub interval_95: [f64; 2],
    /// One sigma between levels; absent where there is one.
    pub between_levels: Option<f64>,
}

/// What a reading was taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Use {
    /// The line goes through it.
    Line,
    /// The rotors give no thrust: it tells the weight to take off.
    Rest,
    /// More throttle gives no more thrust.
    Saturated,
    /// Off the line.
    Outlier,
    /// Beyond `from` and `to`, or of a level that is left out.
    Outside,
}

/// A reading as thrust.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Line in the file.
    pub line: u64,
    /// Index of the battery level.
    pub level: usize,
    /// In the rig's unit.
    pub throttle: f64,
    /// Weight taken off, N.
    pub thrust_n: f64,
    /// What it was taken for.
    pub used: Use,
}

/// The line of one battery level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelLine {
    /// The level as the file names it.
    pub name: String,
    /// N per unit of throttle: value and standard error.
    pub gain_n_per_unit: (f64, f64),
    /// Where the line meets no thrust, units of throttle.
    pub offset: (f64, f64),
    /// Throttle that carries the rig's weight.
    pub hover: (f64, f64),
    /// What the balance shows at rest, as a mass, g.
    pub rest_g: f64,
    /// Thrust at the throttle that hovers on average, less the first level's, over the weight: value and standard error.
    pub thrust_change: (f64, f64),
    /// Thrust begins between these throttles, where the readings show it.
    pub dead_zone: Option<[f64; 2]>,
    /// It ends to grow between these throttles, at this thrust, N.
    pub saturation: Option<([f64; 2], f64)>,
    /// Readings on the line.
    pub readings: usize,
}

/// Whether battery levels have one line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LevelsDiffer {
    /// Probability of such differences if they had.
    pub p: f64,
    /// Greatest difference of thrust at the throttle that hovers, over the weight.
    pub of_weight: f64,
}

/// Whether thrust is linear in throttle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Linearity {
    /// Neither bent nor stepped, or by so little that it does not matter: 1 % of the weight.
    pub linear: bool,
    /// `c` of `T (1 + c (T - W)/W)`, as of the effect `thrust-curve`: value and standard error.
    pub curvature: (f64, f64),
    /// Probability of such a curvature of a line.
    pub curvature_p: f64,
    /// Probability that readings at one throttle agree so much better than the line with them; absent without repeats.
    pub lack_of_fit_p: Option<f64>,
    /// Greatest departure of the bent law from the line, over the weight.
    pub departure_of_weight: f64,
}

/// Below this probability something is not by chance.
const PLAIN_P: f64 = 0.01;
/// A departure from the line below this share of the weight does not matter.
const SMALL_DEPARTURE: f64 = 0.01;
/// Fewest readings of a line.
const LEAST_READINGS: usize = 4;
/// Fewest throttles of a line.
const LEAST_THROTTLES: usize = 3;
/// Fewest repeats that tell the scatter at one throttle.
const LEAST_REPEATS: usize = 5;
/// Greatest thrust over weight of an airframe that may fly lies between these.
const RATIOS: (f64, f64) = (0.1, 10.0);
/// A slope must be so many standard errors above zero.
const SLOPE_SIGMAS: f64 = 4.0;
/// Rounds of refusing and fitting.
const ROUNDS: usize = 20;

/// A reading, `y = thrust + zero`.
#[derive(Clone, Copy)]
struct Row {
    line: u64,
    level: usize,
    throttle: f64,
    y: f64,
    used: Use,
}

/// Readings at one throttle and level: the mean of those used, and how many.
#[derive(Clone, Copy)]
struct Group {
    throttle: f64,
    mean: f64,
    count: usize,
}

/// The line of one level about a throttle in the middle: `y = at_middle + gain (throttle - middle)`, at rest `zero`.
#[derive(Clone, Copy)]
struct Line {
    at_middle: f64,
    gain: f64,
    covariance: Matrix2<f64>,
    zero: f64,
    zero_variance: f64,
}

/// Fits lines to readings of the throttle's thrust, whatever way the airframe is mounted; battery levels each have their own, the
/// rig gets their mean with a tolerance that covers them.
pub fn identify_thrust(
    readings: &Readings,
    rig: &Rig,
    options: &ThrustOptions,
) -> Result<ThrustIdentification, IdentifyError> {
    let mounting = if readings.is_thrust { Mounting::Pressing } else { options.mounting };
    let step = options.resolution_n.unwrap_or(readings.resolution_n);
    let mut fitter = Fitter::new(readings, rig, options, mounting, step)?;
    fitter.segment();
    fitter.drop_poor_levels()?;
    fitter.refuse_outliers()?;
    let found = fitter.fit();
    fitter.check_slope(&found)?;
    Ok(fitter.tell(&found, readings, rig))
}

struct Fitter<'a> {
    rows: Vec<Row>,
    levels: Vec<Level>,
    rig: &'a Rig,
    options: &'a ThrustOptions,
    mounting: Mounting,
    step: f64,
    warnings: Vec<String>,
}

#[derive(Clone, Default)]
struct Level {
    name: String,
    left_out: Option<String>,
    dead_zone: Option<[f64; 2]>,
    saturation: Option<[f64; 2]>,
}

/// All lines at once.
struct Lines {
    middle: f64,
    /// Of the levels that are used, by index.
    of: Vec<(usize, Line)>,
    spread: Spread,
    degrees: f64,
}

impl<'a> Fitter<'a> {
    fn new(
        readings: &Readings,
        rig: &'a Rig,
        options: &'a ThrustOptions,
        mounting: Mounting,
        step: f64,
    ) -> Result<Self, IdentifyError> {
        let sign = mounting.sign();
        let outside = |u: f64| {
            options.from.is_some_and(|from| u < from) && u > rig.airframe.sticks.min
                || options.to.is_some_and(|to| u > to)
        };
        let rows: Vec<Row> = readings
            .rows
            .iter()
            .map(|row| Row {
                line: row.line,
                level: row.level,
                throttle: row.throttle,
                y: sign * row.shown_n,
                used: if outside(row.throttle) { Use::Outside } else { Use::Line },
            })
            .collect();
        let levels =
            readings.levels.iter().map(|name| Level { name: name.clone(), ..Level::default() }).collect();
        let out = Self { rows, levels, rig, options, mounting, step, warnings: Vec::new() };
        let throttles = out.throttles(None);
        let usable = out.rows.iter().filter(|row| row.used == Use::Line).count();
        if usable < LEAST_READINGS || throttles < LEAST_THROTTLES {
            return Err(IdentifyError::TooFewReadings {
                usable,
                throttles,
                level: String::new(),
                least: LEAST_READINGS,
            });
        }
        out.check_scale()?;
        Ok(out)
    }

    /// Different throttles of the readings on the line, of one level or of all.
    fn throttles(&self, level: Option<usize>) -> usize {
        let mut all: Vec<f64> = self
            .rows
            .iter()
            .filter(|row| row.used == Use::Line && level.is_none_or(|level| row.level == level))
            .map(|row| row.throttle)
            .collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all.len()
    }

    /// The range of the readings against the weight tells the unit.
    fn check_scale(&self) -> Result<(), IdentifyError> {
        // An outlier at either end does not count.
        let [low, high] = Sorted::of(self.rows.iter().map(|row| row.y))
            .trimmed_range(12)
            .expect("readings were counted before");
        let ratio = (high - low) / self.rig.airframe.weight_n();
        if (RATIOS.0..RATIOS.1).contains(&ratio) {
            return Ok(());
        }
        let hint = match ratio {
            x if (300.0..5000.0).contains(&x) => ": about 1000 times too much, as milligrams taken for grams",
            x if (30.0..300.0).contains(&x) => ": about 100 times too much, as grams taken for newtons",
            x if (0.003..0.03).contains(&x) => ": about 100 times too little, as newtons taken for grams",
            x if (0.0002..0.003).contains(&x) => {
                ": about 1000 times too little, as kilograms taken for grams"
            }
            x if x <= 0.0 => ": all readings are the same",
            _ => "",
        };
        let weight_g = 1000.0 * self.rig.airframe.mass_kg.value;
        Err(IdentifyError::ForceScale { ratio, weight_g, hint })
    }

    /// Readings of a level that are used for something, by throttle.
    fn groups(&self, level: usize, used: &[Use]) -> Vec<Group> {
        let mut rows: Vec<&Row> =
            self.rows.iter().filter(|row| row.level == level && used.contains(&row.used)).collect();
        rows.sort_by(|a, b| a.throttle.total_cmp(&b.throttle));
        rows.chunk_by(|a, b| a.throttle == b.throttle)
            .map(|rows| Group {
                throttle: rows[0].throttle,
                mean: rows.iter().map(|row| row.y).sum::<f64>() / rows.len() as f64,
                count: rows.len(),
            })
            .collect()
    }

    /// Finds dead zone and saturation of each level.
    fn segment(&mut self) {
        for level in 0..self.levels.len() {
            let mut groups = self.groups(level, &[Use::Line]);
            for group in &mut groups {
                let at: Vec<f64> = self
                    .rows
                    .iter()
                    .filter(|row| {
                        row.level == level && row.used == Use::Line && row.throttle == group.throttle
                    })
                    .map(|row| row.y)
                    .collect();
                group.mean = median(&at);
            }
            let found = Segments::of(&groups, self.rig.airframe.sticks.min, self.step);
            let count = groups.len();
            for row in self.rows.iter_mut().filter(|row| row.level == level && row.used == Use::Line) {
                let at = groups.partition_point(|group| group.throttle < row.throttle);
                if at < found.dead {
                    row.used = Use::Rest;
                } else if at >= count - found.saturated {
                    row.used = Use::Saturated;
                }
            }
        }
    }

    /// Leaves out levels of too few readings; none may be left.
    fn drop_poor_levels(&mut self) -> Result<(), IdentifyError> {
        let mut poor = None;
        for level in 0..self.levels.len() {
            let usable = self.rows.iter().filter(|row| row.level == level && row.used == Use::Line).count();
            let throttles = self.throttles(Some(level));
            if usable >= LEAST_READINGS && throttles >= LEAST_THROTTLES {
                continue;
            }
            let name = &self.levels[level].name;
            let words = if name.is_empty() { String::new() } else { format!(" of battery level {name:?}") };
            self.levels[level].left_out =
                Some(format!("battery level {name:?} has too few readings for a line of its own"));
            for row in &mut self.rows {
                if row.level == level && row.used == Use::Line {
                    row.used = Use::Outside;
                }
            }
            poor = Some(IdentifyError::TooFewReadings {
                usable,
                throttles,
                level: words,
                least: LEAST_READINGS,
            });
        }
        let used = self.levels.iter().any(|level| level.left_out.is_none());
        match poor {
            Some(error) if !used => Err(error),
            _ => Ok(()),
        }
    }

    /// Where a level's balance stands at rest, and its variance: its own readings, else what was given, else another level's.
    fn zeros(&self, spread: Spread) -> Result<Vec<(f64, f64)>, IdentifyError> {
        let own: Vec<Option<(f64, f64)>> = (0..self.levels.len())
            .map(|level| {
                let (mut sum, mut weights) = (0.0, 0.0);
                for group in self.groups(level, &[Use::Rest]) {
                    let weight = spread.of_mean(group.count).recip();
                    sum += weight * group.mean;
                    weights += weight;
                }
                (weights > 0.0).then(|| (sum / weights, weights.recip()))
            })
            .collect();
        let rounding = self.step * self.step / 12.0;
        let given = match (self.options.hanging_n, self.mounting) {
            (Some(hanging_n), Mounting::Suspended) => Some((-hanging_n, rounding)),
            (None, Mounting::Suspended) => None,
            (_, Mounting::Tared | Mounting::Pressing) => Some((0.0, rounding)),
        };
        let shared = own.iter().flatten().next().copied();
        own.into_iter()
            .map(|zero| {
                zero.or(given).or(shared).ok_or(IdentifyError::NoRest { rest: self.rig.airframe.sticks.min })
            })
            .collect()
    }

    /// A first line that outliers do not move, then readings off the line are refused and it is fitted again, until none
    /// changes.
    fn refuse_outliers(&mut self) -> Result<(), IdentifyError> {
        self.zeros(Spread::new(0.0, self.step))?;
        let mut residuals = vec![0.0; self.rows.len()];
        for level in (0..self.levels.len()).filter(|level| self.levels[*level].left_out.is_none()) {
            let of = |used: Use| -> Vec<usize> {
                (0..self.rows.len())
                    .filter(|i| self.rows[*i].level == level && self.rows[*i].used == used)
                    .collect()
            };
            let (line, rest) = (of(Use::Line), of(Use::Rest));
            let points: Vec<(f64, f64)> =
                line.iter().map(|i| (self.rows[*i].throttle, self.rows[*i].y)).collect();
            let (gain, intercept) = theil_sen(&points);
            for i in line {
                residuals[i] = self.rows[i].y - intercept - gain * self.rows[i].throttle;
            }
            let zero = median(&rest.iter().map(|i| self.rows[*i].y).collect::<Vec<_>>());
            for i in rest {
                residuals[i] = self.rows[i].y - zero;
            }
        }
        let candidates: Vec<usize> = (0..self.rows.len())
            .filter(|i| {
                matches!(self.rows[*i].used, Use::Line | Use::Rest)
                    && self.levels[self.rows[*i].level].left_out.is_none()
            })
            .collect();
        let mut was: Vec<Use> = self.rows.iter().map(|row| row.used).collect();
        let first: Vec<f64> = candidates.iter().map(|i| residuals[*i]).collect();
        let mut sigma = robust_sigma(&first, 2 * self.levels.len()).max(self.step / 12_f64.sqrt());
        for _ in 0..ROUNDS {
            let before: Vec<Use> = self.rows.iter().map(|row| row.used).collect();
            for i in &candidates {
                let off = residuals[*i].abs() > REFUSED_SIGMAS * sigma;
                self.rows[*i].used = if off { Use::Outlier } else { was[*i] };
            }
            let refused = candidates.iter().filter(|i| self.rows[**i].used == Use::Outlier).count();
            if refused as f64 > MOST_REFUSED * candidates.len() as f64 {
                return Err(self.scattered(refused, candidates.len()));
            }
            if before.iter().zip(&self.rows).all(|(before, row)| *before == row.used) {
                break;
            }
            self.drop_poor_levels()?;
            self.zeros(Spread::new(0.0, self.step))?;
            let lines = self.fit();
            for i in &candidates {
                let row = &self.rows[*i];
                let Some((_, line)) = lines.of.iter().find(|(level, _)| *level == row.level) else {
                    continue;
                };
                if line.gain > 0.0 && row.throttle < line.offset(lines.middle) {
                    // No rotor pulls down: below where the line meets no thrust there is none.
                    was[*i] = Use::Rest;
                }
                residuals[*i] = match was[*i] {
                    Use::Rest => row.y - line.zero,
                    _ => row.y - line.at_middle - line.gain * (row.throttle - lines.middle),
                };
            }
            sigma = lines.spread.variance.sqrt();
        }
        self.set_edges();
        Ok(())
    }

    /// Thrust begins and ends to grow between throttles that are used.
    fn set_edges(&mut self) {
        for level in 0..self.levels.len() {
            let ends = |used: Use| {
                let own = self.rows.iter().filter(|row| row.level == level && row.used == used);
                own.map(|row| row.throttle).fold(None, |ends: Option<[f64; 2]>, u| {
                    let [low, high] = ends.unwrap_or([u, u]);
                    Some([low.min(u), high.max(u)])
                })
            };
            let line = ends(Use::Line);
            let dead_zone = ends(Use::Rest).zip(line).map(|(rest, line)| [rest[1], line[0]]);
            let saturation = line.zip(ends(Use::Saturated)).map(|(line, flat)| [line[1], flat[0]]);
            self.levels[level].dead_zone = dead_zone.filter(|[from, to]| from < to);
            self.levels[level].saturation = saturation.filter(|[from, to]| from < to);
        }
    }

    fn scattered(&self, refused: usize, all: usize) -> IdentifyError {
        let first = self.rows.iter().find(|row| row.used == Use::Outlier);
        IdentifyError::Scattered {
            refused,
            all,
            law: "line",
            first: first.map_or_else(String::new, |row| format!(", first in line {}", row.line)),
        }
    }

    /// Weighted least squares on the means at each throttle, all levels with one scatter.
    fn fit(&self) -> Lines {
        let used: Vec<usize> =
            (0..self.levels.len()).filter(|level| self.levels[*level].left_out.is_none()).collect();
        let on_line: Vec<&Row> = self.rows.iter().filter(|row| row.used == Use::Line).collect();
        let middle = on_line.iter().map(|row| row.throttle).sum::<f64>() / on_line.len().max(1) as f64;
        let mut spread = Spread::new(0.0, self.step);
        let mut lines = Lines { middle, of: Vec::new(), spread, degrees: 1.0 };
        for _ in 0..4 {
            // Checked before the first fit.
            let Ok(zeros) = self.zeros(spread) else { break };
            lines.of = used
                .iter()
                .map(|level| {
                    let groups = self.groups(*level, &[Use::Line]);
                    (*level, weighted_line(&groups, middle, spread, zeros[*level]))
                })
                .collect();
            let (mut squares, mut readings, mut settings, mut parameters) = (0.0, 0_usize, 0_usize, 0_usize);
            for (level, line) in &lines.of {
                let rest = self.groups(*level, &[Use::Rest]).len();
                settings += self.groups(*level, &[Use::Line]).len() + rest;
                parameters += 2 + usize::from(rest > 0);
                for row in self.rows.iter().filter(|row| row.level == *level) {
                    let residual = match row.used {
                        Use::Line => row.y - line.at_middle - line.gain * (row.throttle - middle),
                        Use::Rest => row.y - line.zero,
                        _ => continue,
                    };
                    squares += residual * residual;
                    readings += 1;
                }
            }
            let free = readings.saturating_sub(parameters).max(1) as f64;
            spread = Spread::new(squares / free, self.step);
            lines.spread = spread;
            lines.degrees = spread.degrees(readings, settings, parameters);
        }
        lines
    }

    fn check_slope(&self, lines: &Lines) -> Result<(), IdentifyError> {
        let n = lines.of.len() as f64;
        let gain = lines.of.iter().map(|(_, line)| line.gain).sum::<f64>() / n;
        let sigma = lines.of.iter().map(|(_, line)| line.covariance[(1, 1)]).sum::<f64>().sqrt() / n;
        if gain > SLOPE_SIGMAS * sigma {
            return Ok(());
        }
        let grams = 1000.0 / GRAVITY_M_S2;
        let falls = gain < -SLOPE_SIGMAS * sigma;
        let advice = match self.mounting {
            _ if !falls => "is the column another one, or the battery flat?",
            Mounting::Suspended | Mounting::Tared => {
                "do the readings grow with thrust? Then give --mounting pressing; else check the columns"
            }
            Mounting::Pressing => {
                "does the balance carry the hanging airframe? Then give --mounting suspended, in a column `reading_g`; else check the columns"
            }
        };
        Err(IdentifyError::ReadingsFall {
            how: if falls { "falls as the throttle rises" } else { "does not follow the throttle" },
            slope_g: gain * grams,
            sigma_g: sigma * grams,
            unit: self.rig.airframe.actuation.unit(),
            advice,
        })
    }
}

/// Slope and intercept by medians over pairs (Theil 1950, Sen 1968): up to 29 % of the points may lie anywhere.
fn theil_sen(points: &[(f64, f64)]) -> (f64, f64) {
    let mut slopes = Vec::with_capacity(points.len() * points.len() / 2);
    for (i, (u, y)) in points.iter().enumerate() {
        slopes.extend(points[..i].iter().filter(|(v, _)| v != u).map(|(v, x)| (y - x) / (u - v)));
    }
    let slope = median(&slopes);
    let rest: Vec<f64> = points.iter().map(|(u, y)| y - slope * u).collect();
    (slope, median(&rest))
}

fn weighted_line(groups: &[Group], middle: f64, spread: Spread, zero: (f64, f64)) -> Line {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for group in groups {
        let row = Vector2::new(1.0, group.throttle - middle);
        let weight = spread.of_mean(group.count).recip();
        normal += weight * row * row.transpose();
        right += weight * group.mean * row;
    }
    let covariance = normal.try_inverse().unwrap_or_else(Matrix2::zeros);
    let solved = covariance * right;
    Line { at_middle: solved[0], gain: solved[1], covariance, zero: zero.0, zero_variance: zero.1 }
}

/// How many of a level's throttles, from the lowest on, give no thrust, and how many, up to the highest, no more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Segments {
    dead: usize,
    saturated: usize,
}

impl Segments {
    /// Compares flat, line, flat for all places of the two edges by a Laplace likelihood with bounded terms, an edge costing what
    /// Schwarz' criterion asks for two parameters. Throttles at `rest` give no thrust by definition.
    fn of(groups: &[Group], rest: f64, step: f64) -> Self {
        let count = groups.len();
        let at_rest = groups.iter().take_while(|group| group.throttle <= rest).count();
        let least = Self { dead: at_rest, saturated: 0 };
        if count < at_rest + LEAST_THROTTLES + 1 {
            return least;
        }
        let candidates: Vec<Self> = (at_rest..=count - LEAST_THROTTLES)
            .flat_map(|dead| {
                (0..=count - LEAST_THROTTLES - dead).map(move |saturated| Self { dead, saturated })
            })
            // One reading above the others' end is an outlier, not a saturation.
            .filter(|one| one.saturated != 1)
            .collect();
        let floor = 0.25 * step;
        let fits: Vec<Option<Vec<f64>>> = candidates.iter().map(|one| one.residuals(groups)).collect();
        let scale_of = |residuals: &[f64]| {
            let sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
            median(&sizes).max(floor)
        };
        let total = |residuals: &[f64], most: f64| residuals.iter().map(|r| r.abs().min(most)).sum::<f64>();
        let Some(first) =
            fits.iter().flatten().min_by(|a, b| total(a, f64::INFINITY).total_cmp(&total(b, f64::INFINITY)))
        else {
            return least;
        };
        let scale = 1.44 * scale_of(first);
        let cost = |(one, residuals): &(&Self, &Vec<f64>)| {
            let edges = usize::from(one.dead > at_rest) + usize::from(one.saturated > 0);
            2.0 * total(residuals, 5.0 * scale) / scale + 2.0 * edges as f64 * (count as f64).ln()
        };
        candidates
            .iter()
            .zip(&fits)
            .filter_map(|(one, residuals)| Some((one, residuals.as_ref()?)))
            .min_by(|a, b| cost(a).total_cmp(&cost(b)))
            .map_or(least, |(one, _)| *one)
    }

    /// Residuals of the medians; `None` where the parts do not join as flat, line, flat do.
    fn residuals(self, groups: &[Group]) -> Option<Vec<f64>> {
        let end = groups.len() - self.saturated;
        let (dead, line, flat) = (&groups[..self.dead], &groups[self.dead..end], &groups[end..]);
        let points: Vec<(f64, f64)> = line.iter().map(|group| (group.throttle, group.mean)).collect();
        let (gain, intercept) = theil_sen(&points);
        let level = |groups: &[Group]| median(&groups.iter().map(|group| group.mean).collect::<Vec<_>>());
        let (low, high) = (level(dead), level(flat));
        if let Some(first) = flat.first() {
            let on_line = intercept + gain * first.throttle;
            if (on_line - high) * gain <= 0.0 {
                return None;
            }
        }
        let off_line = line.iter().map(|group| group.mean - intercept - gain * group.throttle);
        let off_low = dead.iter().map(|group| group.mean - low);
        let off_high = flat.iter().map(|group| group.mean - high);
        Some(off_low.chain(off_line).chain(off_high).collect())
    }
}

impl Line {
    /// Throttle at which it meets no thrust.
    fn offset(&self, middle: f64) -> f64 {
        middle - (self.at_middle - self.zero) / self.gain
    }

    /// Thrust at the middle, N, with its covariance with the gain.
    fn thrust(&self) -> (Vector2<f64>, Matrix2<f64>) {
        let mut covariance = self.covariance;
        covariance[(0, 0)] += self.zero_variance;
        (Vector2::new(self.at_middle - self.zero, self.gain), covariance)
    }
}

/// A value with its standard error.
type Told = (f64, f64);

/// Gain, offset and the throttle that hovers of a line `thrust = x[0] + x[1] (throttle - middle)`.
fn numbers_of(x: &Vector2<f64>, covariance: &Matrix2<f64>, middle: f64, weight_n: f64) -> [Told; 3] {
    let (thrust, gain) = (x[0], x[1]);
    let sigma = |slopes: Vector2<f64>| (slopes.transpose() * covariance * slopes)[(0, 0)].max(0.0).sqrt();
    let carries = |force: f64| {
        let slopes = Vector2::new(-gain.recip(), -(force - thrust) / (gain * gain));
        (middle + (force - thrust) / gain, sigma(slopes))
    };
    [(gain, covariance[(1, 1)].max(0.0).sqrt()), carries(0.0), carries(weight_n)]
}

/// What is left of a spread of values when their own errors are taken off, one sigma; `None` of a single one.
fn spread_of(values: &[Told]) -> Option<f64> {
    let n = values.len() as f64;
    if values.len() < 2 {
        return None;
    }
    let mean = values.iter().map(|(value, _)| value).sum::<f64>() / n;
    let total = values.iter().map(|(value, _)| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let errors = values.iter().map(|(_, sigma)| sigma * sigma).sum::<f64>() / n;
    Some((total - errors).max(0.0).sqrt())
}

impl Fitter<'_> {
    fn tell(mut self, lines: &Lines, readings: &Readings, rig: &Rig) -> ThrustIdentification {
        let weight_n = rig.airframe.weight_n();
        let each: Vec<[Told; 3]> = lines
            .of
            .iter()
            .map(|(_, line)| {
                let (x, covariance) = line.thrust();
                numbers_of(&x, &covariance, lines.middle, weight_n)
            })
            .collect();
        let (mean, covariance) = mean_line(&lines.of);
        let common = numbers_of(&mean, &covariance, lines.middle, weight_n);
        let half = half_width_95(lines.degrees);
        let mass = rig.airframe.mass_kg;
        let from_mass = weight_n / common[0].0 * mass.sigma / mass.value;
        let thrust = rig.airframe.thrust;
        let hover = rig.airframe.throttle_for(weight_n);
        let hover_before = thrust.hover_sigma.unwrap_or_else(|| {
            let range = weight_n / thrust.gain_n_per_unit.value;
            let relative = thrust.gain_n_per_unit.sigma / thrust.gain_n_per_unit.value;
            thrust.offset.sigma.hypot(range * relative.hypot(mass.sigma / mass.value))
        });
        let before = [
            ("thrust_gain", (thrust.gain_n_per_unit.value, thrust.gain_n_per_unit.sigma), 0.0),
            ("thrust_offset", (thrust.offset.value, thrust.offset.sigma), 0.0),
            ("thrust_hover", (hover, hover_before), from_mass),
        ];
        let numbers = [0, 1, 2].map(|i| {
            let (name, before, beside) = before[i];
            let (value, standard_error) = common[i];
            let between_levels = spread_of(&each.iter().map(|numbers| numbers[i]).collect::<Vec<_>>());
            let sigma = standard_error.hypot(between_levels.unwrap_or(0.0)).hypot(beside);
            let interval_95 = [value - half * standard_error, value + half * standard_error];
            Measured { name, before, after: (value, sigma), standard_error, interval_95, between_levels }
        });
        let levels: Vec<LevelLine> = lines
            .of
            .iter()
            .zip(&each)
            .map(|((level, line), numbers)| self.level(*level, line, numbers, lines, common[2].0))
            .collect();
        let levels_differ = (lines.of.len() > 1).then(|| LevelsDiffer {
            p: levels_p(lines),
            of_weight: levels
                .iter()
                .flat_map(|a| levels.iter().map(|b| (a.thrust_change.0 - b.thrust_change.0).abs()))
                .fold(0.0, f64::max),
        });
        let linearity = self.linearity(lines, weight_n, common[0].0);
        self.warn(&numbers, &linearity, lines, rig);
        let points = self.points(lines);
        let mut refused = readings.refused.clone();
        refused.extend(self.refused(lines, &points));
        refused.sort_by_key(|refused| refused.line);
        let mut out = rig.clone();
        out.airframe.thrust.gain_n_per_unit = uncertain(&numbers[0]);
        out.airframe.thrust.offset = uncertain(&numbers[1]);
        out.airframe.thrust.hover_sigma = Some(numbers[2].after.1);
        ThrustIdentification {
            schema: "bench.identification.thrust/1",
            throttle_unit: rig.airframe.actuation.unit(),
            numbers,
            levels,
            levels_differ,
            linearity,
            reading_sigma_n: lines.spread.variance.sqrt(),
            resolution_n: self.step,
            points,
            refused,
            warnings: self.warnings,
            rig: out,
        }
    }

    fn level(&self, level: usize, line: &Line, numbers: &[Told; 3], lines: &Lines, hover: f64) -> LevelLine {
        let weight_n = self.rig.airframe.weight_n();
        let at_hover = |line: &Line| {
            let (x, covariance) = line.thrust();
            let row = Vector2::new(1.0, hover - lines.middle);
            (row.dot(&x) / weight_n, (row.transpose() * covariance * row)[(0, 0)].max(0.0).sqrt() / weight_n)
        };
        let (own, first) = (at_hover(line), at_hover(&lines.of[0].1));
        let change =
            if level == lines.of[0].0 { (0.0, 0.0) } else { (own.0 - first.0, own.1.hypot(first.1)) };
        let saturated: Vec<f64> = self
            .rows
            .iter()
            .filter(|row| row.level == level && row.used == Use::Saturated)
            .map(|row| row.y - line.zero)
            .collect();
        LevelLine {
            name: self.levels[level].name.clone(),
            gain_n_per_unit: numbers[0],
            offset: numbers[1],
            hover: numbers[2],
            rest_g: self.mounting.sign() * line.zero * 1000.0 / GRAVITY_M_S2,
            thrust_change: change,
            dead_zone: self.levels[level].dead_zone,
            saturation: self.levels[level].saturation.map(|edge| (edge, median(&saturated))),
            readings: self.rows.iter().filter(|row| row.level == level && row.used == Use::Line).count(),
        }
    }

    /// A parabola on top of each level's line, and the scatter about the line against that of repeats.
    fn linearity(&self, lines: &Lines, weight_n: f64, gain: f64) -> Linearity {
        let (mut numerator, mut information) = (0.0, 0.0);
        let (mut within, mut repeats) = (0.0, 0_usize);
        let mut bends: Vec<f64> = Vec::new();
        let mut between: Vec<(Group, f64)> = Vec::new();
        let mut settings = 0_usize;
        for (level, line) in &lines.of {
            let groups = self.groups(*level, &[Use::Line]);
            settings += groups.len().saturating_sub(2);
            let square: Vec<Group> =
                groups.iter().map(|g| Group { mean: (g.throttle - lines.middle).powi(2), ..*g }).collect();
            let own = weighted_line(&square, lines.middle, lines.spread, (0.0, 0.0));
            for (group, square) in groups.iter().zip(&square) {
                let from_middle = group.throttle - lines.middle;
                let bend = square.mean - own.at_middle - own.gain * from_middle;
                let residual = group.mean - line.at_middle - line.gain * from_middle;
                let weight = lines.spread.of_mean(group.count).recip();
                numerator += weight * bend * residual;
                information += weight * bend * bend;
                bends.push(bend);
                between.push((*group, residual));
                for row in self.rows.iter().filter(|row| {
                    row.level == *level && row.used == Use::Line && row.throttle == group.throttle
                }) {
                    within += (row.y - group.mean).powi(2);
                }
                repeats += group.count - 1;
            }
        }
        if information <= 0.0 {
            return Linearity {
                linear: true,
                curvature: (0.0, 0.0),
                curvature_p: 1.0,
                lack_of_fit_p: None,
                departure_of_weight: 0.0,
            };
        }
        let (bent, sigma) = (numerator / information, information.sqrt().recip());
        let per_curvature = weight_n / (gain * gain);
        let lack_of_fit_p = (repeats >= LEAST_REPEATS && settings > 0).then(|| {
            // What repeats share is no part of their own scatter.
            let own = within / repeats as f64;
            let noise = (own - self.step * self.step / 12.0).max(0.0);
            let spread = Spread::new(noise + self.step * self.step / 12.0, self.step);
            let chi: f64 = between.iter().map(|(group, r)| r * r / spread.of_mean(group.count)).sum();
            f_tail(chi / settings as f64, settings as f64, repeats as f64)
        });
        let curvature_p = two_sided_p(bent / sigma, lines.degrees - 1.0);
        let departure = bends.iter().map(|bend| (bend * bent).abs()).fold(0.0, f64::max) / weight_n;
        let plain = curvature_p < PLAIN_P || lack_of_fit_p.is_some_and(|p| p < PLAIN_P);
        let greatest = between.iter().map(|(_, r)| r.abs()).fold(0.0, f64::max) / weight_n;
        Linearity {
            linear: !plain || departure.max(greatest) < SMALL_DEPARTURE,
            curvature: (bent * per_curvature, sigma * per_curvature),
            curvature_p,
            lack_of_fit_p,
            departure_of_weight: departure,
        }
    }

    fn warn(&mut self, numbers: &[Measured; 3], linearity: &Linearity, lines: &Lines, rig: &Rig) {
        let unit = rig.airframe.actuation.unit();
        let left = self.levels.iter().filter_map(|level| level.left_out.clone());
        let mut warnings: Vec<String> = left.collect();
        if !linearity.linear {
            warnings.push(format!(
                "thrust is no line in throttle here (curvature {:.3} ± {:.3}, p {:.1e}): keep to the range of flight with --from and --to, or add the effect thrust-curve:curvature={:.3} to the rig",
                linearity.curvature.0, linearity.curvature.1, linearity.curvature_p, linearity.curvature.0
            ));
        }
        let on_line = || self.rows.iter().filter(|row| row.used == Use::Line).map(|row| row.throttle);
        let (low, high) = (on_line().fold(f64::MAX, f64::min), on_line().fold(f64::MIN, f64::max));
        let hover = numbers[2].after.0;
        if !(low..=high).contains(&hover) {
            warnings.push(format!(
                "the throttle that hovers, {hover:.3} {unit}, is outside the readings' {low} to {high}: it is extrapolated"
            ));
        }
        for number in numbers {
            let allowed = number.before.1.hypot(number.after.1);
            let off = (number.after.0 - number.before.0) / allowed;
            if allowed > 0.0 && off.abs() > 4.0 {
                warnings.push(format!(
                    "{} is {:.4}, {:.0} tolerances from the {:.4} of the rig: another airframe, or a rig that was guessed",
                    number.name,
                    number.after.0,
                    off.abs(),
                    number.before.0
                ));
            }
        }
        if lines.of.len() == 1 {
            warnings.push(
                "one battery level: how thrust differs between levels is not known, and not in the tolerances"
                    .to_owned(),
            );
        }
        let mass_n = rig.airframe.weight_n();
        let hanging_n = -lines.of[0].1.zero;
        let light = hanging_n < mass_n - 3.0 * rig.airframe.mass_kg.sigma * GRAVITY_M_S2 - self.step;
        if self.mounting == Mounting::Suspended && light {
            warnings.push(format!(
                "at rest the balance shows {:.1} g, less than the airframe's {:.1} g: was it zeroed (--mounting tared), or is it on a lever?",
                hanging_n * 1000.0 / GRAVITY_M_S2,
                1000.0 * rig.airframe.mass_kg.value
            ));
        }
        let floor = |row: &&Row| row.used == Use::Saturated && row.y.abs() <= self.step;
        if self.mounting == Mounting::Suspended && self.rows.iter().any(|row| floor(&row)) {
            warnings.push(
                "thrust ends to grow where the balance carries nothing more: hang more ballast below the airframe"
                    .to_owned(),
            );
        }
        self.warnings = warnings;
    }

    fn points(&self, lines: &Lines) -> Vec<Point> {
        let zero = |level: usize| {
            let own = lines.of.iter().find(|(known, _)| *known == level).or(lines.of.first());
            own.map_or(0.0, |(_, line)| line.zero)
        };
        let point = |row: &Row| Point {
            line: row.line,
            level: row.level,
            throttle: row.throttle,
            thrust_n: row.y - zero(row.level),
            used: row.used,
        };
        self.rows.iter().map(point).collect()
    }

    fn refused(&self, lines: &Lines, points: &[Point]) -> Vec<Refused> {
        let sigma = lines.spread.variance.sqrt();
        points
            .iter()
            .filter_map(|point| {
                let why = match point.used {
                    Use::Line => return None,
                    Use::Rest => "no thrust yet: used for the weight alone".to_owned(),
                    Use::Saturated => "thrust no longer grows".to_owned(),
                    Use::Outside => match &self.levels[point.level].left_out {
                        Some(why) => why.clone(),
                        None => "outside --from and --to".to_owned(),
                    },
                    Use::Outlier => {
                        let off =
                            lines.of.iter().find(|(level, _)| *level == point.level).map(|(_, line)| {
                                let (x, _) = line.thrust();
                                point.thrust_n - (x[0] + x[1] * (point.throttle - lines.middle)).max(0.0)
                            })?;
                        format!(
                            "off the line by {:+.2} g, {:.0} sigma",
                            off * 1000.0 / GRAVITY_M_S2,
                            off.abs() / sigma
                        )
                    }
                };
                Some(Refused {
                    line: point.line,
                    throttle: Some(point.throttle),
                    thrust_n: Some(point.thrust_n),
                    why,
                })
            })
            .collect()
    }
}

fn uncertain(number: &Measured) -> Uncertain {
    Uncertain { value: number.after.0, sigma: number.after.1 }
}

/// The mean of the levels' lines. Levels that share a zero share its error.
fn mean_line(lines: &[(usize, Line)]) -> (Vector2<f64>, Matrix2<f64>) {
    let n = lines.len() as f64;
    let (mut mean, mut covariance) = (Vector2::zeros(), Matrix2::zeros());
    for (_, line) in lines {
        mean += line.thrust().0 / n;
        covariance += line.covariance / (n * n);
        let sharing = lines.iter().filter(|(_, other)| other.zero == line.zero).count() as f64;
        covariance[(0, 0)] += line.zero_variance * sharing / (n * n);
    }
    (mean, covariance)
}

/// Probability of such differences between lines if all were one (Wald).
fn levels_p(lines: &Lines) -> f64 {
    let told: Vec<_> = lines.of.iter().map(|(_, line)| line.thrust()).collect();
    let (mut information, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for (x, covariance) in &told {
        let own = covariance.try_inverse().unwrap_or_else(Matrix2::zeros);
        information += own;
        right += own * x;
    }
    let common = information.try_inverse().unwrap_or_else(Matrix2::zeros) * right;
    let squares: f64 = told
        .iter()
        .map(|(x, covariance)| {
            let off = x - common;
            (off.transpose() * covariance.try_inverse().unwrap_or_else(Matrix2::zeros) * off)[(0, 0)]
        })
        .sum();
    let degrees = 2.0 * (told.len() as f64 - 1.0);
    f_tail(squares / degrees, degrees, lines.degrees)
}

//! Where the model fails: a free acceleration over altitude, speed, thrust, time and charge, on top of a fit.
//!
//! With the innovations' sensitivities to hat functions at the fit's mode, the evidence of a free acceleration with a
//! normal prior of width `s` is analytic: `1/2 g'(F + 1/s^2)^-1 g - 1/2 ln|1 + s^2 F|`, where gradient `g` and
//! information `F` are what the fitted parameters leave of them (Schur complement).

use bench_filter::{Direction, Hat, Innovation, Pairs, Pass, Prediction, Seen, innovations, run, run_for};
use bench_plant::effects::{Axis, LIBRARY};
use bench_statistics::{FAR_SIGMAS, evenly_in_log, ln_det};
use nalgebra::{Complex, DMatrix, DVector, Matrix2};

use crate::{
    coordinate::{directions, project},
    fit::{Fit, Problem},
};

/// A free acceleration over one quantity.
#[derive(Clone, Debug)]
pub struct Region {
    /// Which quantity.
    pub axis: Axis,
    /// Where the hats stand.
    pub knots: Vec<f64>,
    /// Acceleration at each knot, m/s^2.
    pub acceleration_m_s2: Vec<f64>,
    /// One sigma of each.
    pub sigma_m_s2: Vec<f64>,
    /// Gain of log-evidence at the best prior width; 0 if none is a gain.
    pub gain: f64,
}

/// What a free acceleration would add to a fit.
#[derive(Clone, Debug)]
pub struct Regions {
    /// One a quantity, in the order of [`Axis::ALL`].
    pub axes: Vec<Region>,
    /// Gain of log-evidence with all quantities of the moment free at once: what no known law may explain. At the best prior width.
    pub ceiling: f64,
    /// The same with the prior width integrated over, from 0.2 % to 20 % of gravity, evenly in its logarithm; may be below 0.
    pub nameless: f64,
    /// Gain of log-evidence of what any model of an airframe and a tracker gets wrong: an acceleration of up to 0.1 % of gravity, or an
    /// offset of the tracker over altitude of up to a sigma of its noise.
    pub slight: f64,
    /// The part of it that lies along the fitted effects' own quantities: their laws may be of another form.
    pub form: f64,
    /// Gain of log-evidence of an acceleration over the altitude of late; 0 where a law of the fit remembers that.
    pub past: f64,
    /// The same of an acceleration that grows from flight to flight, in the order in which they are given; 0 where a battery's
    /// charge is fitted, which may not have been made good between them.
    pub drift: f64,
    /// Gain of log-evidence of a play of the thrust; 0 where a law of the fit depends on changes of thrust, too.
    pub play: f64,
    /// Offsets of measurements over altitude, thrust and time, and a latency that grows: name and gain of log-evidence.
    pub tracker: Vec<(&'static str, f64)>,
}

impl Regions {
    /// The most that an offset of the tracker gains, nats; 0 for none.
    pub fn offset(&self) -> f64 {
        self.tracker.iter().map(|(_, gain)| *gain).fold(0.0, f64::max)
    }
}

/// Accelerations that swing, each flight with its own size and phase.
#[derive(Clone, Debug, Default)]
pub struct Waves {
    /// Frequency, Hz, and gain of log-evidence, lowest first.
    pub gains: Vec<(f64, f64)>,
    /// Among how many frequencies those were chosen.
    pub tried: usize,
}

impl Waves {
    /// The frequency with the highest gain, Hz, and that gain less what the choice among all is worth.
    pub fn highest(&self) -> (f64, f64) {
        let best = self.gains.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
        (best.0, (best.1 - (self.tried.max(1) as f64).ln()).max(0.0))
    }
}

/// Quantities along which another form of an effect's law would show.
pub fn own_axes(effect: usize) -> &'static [Axis] {
    LIBRARY[effect].signature.axes
}

const KNOTS: usize = 6; // numerical
/// Along the altitude things may be narrow.
const ALTITUDE_KNOTS: usize = 12; // numerical
/// Prior widths that are tried, m/s^2: from 0.2 % to 20 % of gravity.
const WIDTHS: [f64; 6] = [0.02, 0.05, 0.12, 0.3, 0.8, 2.0]; // numerical
/// Widths of what is no gap, m/s^2: up to 0.1 % of gravity.
const SLIGHT_WIDTHS: [f64; 2] = [0.005, 0.01];

/// Looks for structure that a fit leaves.
pub fn regions(problem: &Problem<'_>, fit: &Fit) -> Regions {
    let plain = problem.predict(&fit.point, &fit.full_noise(problem));
    let mut directions = directions(&fit.free, &fit.point);
    let fitted = directions.len();
    let (mut knots_by_axis, mut hat_axes) = (Vec::new(), Vec::new());
    let mut altitudes = Vec::new();
    for (index, axis) in Axis::ALL.into_iter().enumerate() {
        let most = if axis == Axis::Altitude { ALTITUDE_KNOTS } else { KNOTS };
        let knots = knots(innovations(&plain).map(|innovation| innovation.axes[index]).collect(), most);
        let hats = hats(axis, &knots);
        if axis == Axis::Altitude {
            altitudes.clone_from(&hats);
        }
        if axis != Axis::Past {
            hat_axes.extend(hats.iter().map(|_| axis));
        }
        directions.extend(hats.into_iter().map(Direction::Hat));
        knots_by_axis.push(knots);
    }
    let forces = directions.len() - fitted;
    let offsets = altitudes.len();
    directions.extend(altitudes.into_iter().map(|hat| Direction::Seen(Seen::Altitude(hat))));
    directions.extend([Seen::Thrust, Seen::Time, Seen::Latency].map(Direction::Seen));
    directions.extend(PLAYS.map(Direction::Play));
    directions.push(Direction::Steady);
    let pass = run(problem.tracks, problem.rig, &fit.point, &fit.full_noise(problem), &directions);
    let Some((information, gradient)) = project(&fit.free, &fit.point, &pass) else {
        return Regions {
            axes: Vec::new(),
            ceiling: 0.0,
            nameless: 0.0,
            slight: 0.0,
            form: 0.0,
            past: 0.0,
            drift: 0.0,
            play: 0.0,
            tracker: Vec::new(),
        };
    };

    let mut axes = Vec::new();
    let mut first = 0;
    for (axis, knots) in Axis::ALL.into_iter().zip(knots_by_axis) {
        let n = knots.len();
        let f = information.view((first, first), (n, n)).into_owned();
        let g = gradient.rows(first, n).into_owned();
        let (gain, width) = best_gain(&f, &g, &WIDTHS);
        let (acceleration_m_s2, sigma_m_s2) = solution(&f, &g, width);
        axes.push(Region { axis, knots, acceleration_m_s2, sigma_m_s2, gain });
        first += n;
    }
    let of_the_moment = hat_axes.len();
    let moment = information.view((0, 0), (of_the_moment, of_the_moment)).into_owned();
    let of_moment = gradient.rows(0, of_the_moment).into_owned();
    let gains = WIDTHS.map(|s| gain_at(&moment, &of_moment, s).unwrap_or(0.0));
    let ceiling = gains.into_iter().fold(0.0, f64::max);
    let noise_m = fit.noise.measurement_m;
    let tracker = seen(&information, &gradient, forces, offsets, noise_m);
    // Before the steady one.
    let plays = gradient.len() - 1 - PLAYS.len();
    let is_own = |axis: Axis| fit.effects().iter().any(|effect| own_axes(*effect).contains(&axis));
    let own: Vec<usize> = (0..of_the_moment).filter(|i| is_own(hat_axes[*i])).collect();
    let f = DMatrix::from_fn(own.len(), own.len(), |i, j| information[(own[i], own[j])]);
    let g = DVector::from_fn(own.len(), |i, _| gradient[own[i]]);
    let form = if own.is_empty() { 0.0 } else { best_gain(&f, &g, &WIDTHS).0 };
    let past = axes.iter().find(|region| region.axis == Axis::Past).map_or(0.0, |region| region.gain);
    Regions {
        axes,
        ceiling,
        nameless: mean_evidence(gains),
        slight: {
            let of_tracker = information.view((forces, forces), (offsets, offsets)).into_owned();
            let slope = gradient.rows(forces, offsets).into_owned();
            let offset = |share: f64| gain_at(&of_tracker, &slope, share * noise_m).unwrap_or(0.0);
            let [narrow, wide] = SLIGHT_WIDTHS.map(|s| gain_at(&moment, &of_moment, s).unwrap_or(0.0));
            mean_evidence([narrow, wide, offset(0.5), offset(1.0)])
        },
        form,
        past: if is_own(Axis::Past) { 0.0 } else { past },
        drift: if is_own(Axis::Charge) { 0.0 } else { drift(fit, &pass) },
        play: if is_own(Axis::ThrustChange) { 0.0 } else { play(&information, &gradient, plays) },
        tracker,
    }
}

/// Widths of the play that are tried, over the weight.
const PLAYS: [f64; 4] = [0.003, 0.01, 0.03, 0.1]; // numerical

/// Gain of log-evidence of a play, whose directions begin at `first`: thrust that stays behind, not one that hurries ahead.
fn play(information: &DMatrix<f64>, gradient: &DVector<f64>, first: usize) -> f64 {
    let behind = (first..first + PLAYS.len()).filter(|i| gradient[*i] < 0.0);
    behind.map(|i| gain_along(information, gradient, (i, 1), &WIDTHS)).fold(0.0, f64::max)
}

/// Fewer flights show a difference, and no drift.
const DRIFTING_FLIGHTS: usize = 3;

/// Gain of log-evidence of an acceleration that grows by the same from each flight to the next, from a pass over what was fitted,
/// first, and a steady acceleration, last.
fn drift(fit: &Fit, pass: &Pass) -> f64 {
    if pass.tracks.len() < DRIFTING_FLIGHTS {
        return 0.0;
    }
    let (fitted, steady) = (fit.free.len(), pass.gradient.len() - 1);
    let mut drift = Pass {
        gradient: DVector::zeros(fitted + 1),
        information: DMatrix::zeros(fitted + 1, fitted + 1),
        ..Pass::default()
    };
    drift.gradient.rows_mut(0, fitted).copy_from(&pass.gradient.rows(0, fitted));
    let numbers = ((0, 0), (fitted, fitted));
    drift.information.view_mut(numbers.0, numbers.1).copy_from(&pass.information.view(numbers.0, numbers.1));
    // From -1 in the first flight to 1 in the last.
    let per_flight = 2.0 / (pass.tracks.len() - 1) as f64;
    for (i, track) in pass.tracks.iter().enumerate() {
        let share = per_flight * i as f64 - 1.0;
        drift.gradient[fitted] += share * track.gradient[steady];
        for j in 0..fitted {
            drift.information[(fitted, j)] += share * track.information[(steady, j)];
        }
        drift.information[(fitted, fitted)] += share * share * track.information[(steady, steady)];
    }
    project(&fit.free, &fit.point, &drift).map_or(0.0, |(f, g)| best_gain(&f, &g, &WIDTHS).0)
}

/// Prior widths of what a tracker gets wrong: m over altitude and thrust, m/s over time, s/s of latency.
const OFFSETS_M: [f64; 5] = [5e-4, 1e-3, 2e-3, 5e-3, 0.02]; // numerical
const THRUST_OFFSETS_M: [f64; 4] = [0.003, 0.01, 0.03, 0.1]; // numerical
const DRIFTS_M_S: [f64; 4] = [1e-5, 1e-4, 3e-4, 1e-3]; // numerical
const LATENCY_DRIFTS: [f64; 4] = [2e-4, 6e-4, 2e-3, 6e-3]; // numerical

fn seen(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    first: usize,
    hats: usize,
    noise_m: f64,
) -> Vec<(&'static str, f64)> {
    // Within its noise an offset is none that a tracker is blamed for.
    let plain = OFFSETS_M.map(|s| s.max(noise_m));
    let parts: [(&str, usize, usize, &[f64]); 4] = [
        ("altitude", first, hats, &plain),
        ("thrust", first + hats, 1, &THRUST_OFFSETS_M),
        ("time", first + hats + 1, 1, &DRIFTS_M_S),
        ("latency", first + hats + 2, 1, &LATENCY_DRIFTS),
    ];
    parts
        .into_iter()
        .map(|(name, at, n, widths)| (name, gain_along(information, gradient, (at, n), widths)))
        .collect()
}

/// Lowest and highest frequency of waves, Hz, and how many are tried in any case, evenly in the logarithm.
const WAVES_HZ: (f64, f64, usize) = (0.15, 4.0, 24); // numerical
/// Over a flight a tone falls out of step with them, so the plainest tones of the innovations are tried too: so many.
const TONES: usize = 3; // numerical
/// Among so many at most: the finest that flights of two minutes tell apart.
const MOST_TONES: usize = 1000; // numerical

/// Looks for a swing that a fit leaves.
pub fn waves(problem: &Problem<'_>, fit: &Fit) -> Waves {
    let noise = fit.full_noise(problem);
    let plain = problem.predict(&fit.point, &noise);
    let (mut tried, tones) = tones(&plain);
    let (low, high, n) = WAVES_HZ;
    tried += n;
    let mut hz: Vec<f64> = evenly_in_log(low, high, n).chain(tones).collect();
    hz.sort_by(f64::total_cmp);
    let directions: Vec<_> = hz
        .iter()
        .flat_map(|hz| [0.0, std::f64::consts::FRAC_PI_2].map(|phase| Direction::Wave(*hz, phase)))
        .collect();
    // Both phases of a frequency are one block.
    let pairs = Pairs::Arrow { head: 0, block: 2 };
    let pass = run_for(problem.tracks, problem.rig, &fit.point, &noise, &directions, pairs);
    let gain = |i: usize| {
        WIDTHS
            .into_iter()
            .map(|s| {
                let each = pass.tracks.iter().map(|track| {
                    let f =
                        track.information.fixed_view::<2, 2>(2 * i, 2 * i) + Matrix2::identity() * s.powi(-2);
                    let g = track.gradient.fixed_rows::<2>(2 * i);
                    f.cholesky().map_or(0.0, |f| {
                        0.5 * g.dot(&f.solve(&g)) - 0.5 * f.determinant().ln() - 2.0 * s.ln()
                    })
                });
                each.sum::<f64>()
            })
            .fold(0.0, f64::max)
    };
    Waves { gains: hz.iter().enumerate().map(|(i, hz)| (*hz, gain(i))).collect(), tried }
}

/// How many frequencies the innovations of flights can tell apart, and those of them at which they swing the most: a filter
/// passes on the frequency of what it did not foresee. The power at a frequency is the sum over flights of each one's
/// (Lomb, *Least-squares frequency analysis of unequally spaced data*, Astrophysics and Space Science 39, 1976, for times as
/// good as even).
fn tones(plain: &[Prediction]) -> (usize, Vec<f64>) {
    let (low, high, _) = WAVES_HZ;
    let lasted_s = |innovations: &[Innovation]| match innovations {
        [first, .., last] => last.exposed_s - first.exposed_s,
        _ => 0.0,
    };
    let longest_s = plain.iter().map(|track| lasted_s(&track.innovations)).fold(1.0, f64::max);
    // A tone half way between two of them loses a fifth of its power.
    let step_hz = 0.5 / longest_s;
    let count = (((high - low) / step_hz) as usize + 1).min(MOST_TONES);
    let step_hz = (high - low) / (count.max(2) - 1) as f64;
    let mut power = vec![0.0; count];
    for track in plain {
        let mut sums = vec![Complex::new(0.0, 0.0); count];
        for innovation in &track.innovations {
            let turn = |hz: f64| Complex::from_polar(1.0, std::f64::consts::TAU * hz * innovation.exposed_s);
            let (mut at, on) = (turn(low), turn(step_hz));
            let size = innovation.residual_m / innovation.variance_m2.sqrt();
            let size = size.clamp(-FAR_SIGMAS, FAR_SIGMAS);
            for sum in &mut sums {
                *sum += at * size;
                at *= on;
            }
        }
        let samples = track.innovations.len().max(1) as f64;
        for (power, sum) in power.iter_mut().zip(sums) {
            *power += sum.norm_sqr() / samples;
        }
    }
    let at = |k: usize| power.get(k).copied().unwrap_or(0.0);
    let mut peaks: Vec<usize> =
        (0..count).filter(|k| at(*k) > at(k.wrapping_sub(1)) && at(*k) >= at(k + 1)).collect();
    peaks.sort_by(|a, b| at(*b).total_cmp(&at(*a)));
    (count, peaks.into_iter().take(TONES).map(|k| low + step_hz * k as f64).collect())
}

/// Quantiles of what was flown, those that coincide left out.
fn knots(mut values: Vec<f64>, most: usize) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    let (Some(low), Some(high)) = (values.first(), values.last()) else { return Vec::new() };
    if high - low < 1e-9 {
        // Never varied, or never measured.
        return Vec::new();
    }
    let least = 0.02 * (high - low);
    let mut knots: Vec<f64> = Vec::new();
    for k in 0..most {
        let at = values[k * (values.len() - 1) / (most - 1)];
        if knots.last().is_none_or(|last| at - last > least) {
            knots.push(at);
        }
    }
    knots
}

/// A hat function at each knot.
fn hats(axis: Axis, knots: &[f64]) -> Vec<Hat> {
    let last = knots.len().saturating_sub(1);
    let hat =
        |k: usize| Hat { axis, knots: [knots[k.saturating_sub(1)], knots[k], knots[(k + 1).min(last)]] };
    (0..knots.len()).map(hat).collect()
}

/// The best gain over the prior widths, and that width.
fn best_gain(f: &DMatrix<f64>, g: &DVector<f64>, widths: &[f64]) -> (f64, f64) {
    widths
        .iter()
        .copied()
        .filter_map(|s| Some((gain_at(f, g, s)?, s)))
        .fold((0.0, widths[0]), |best, this| if this.0 > best.0 { this } else { best })
}

/// The gain at a prior width; `None` where the information is none.
fn gain_at(f: &DMatrix<f64>, g: &DVector<f64>, s: f64) -> Option<f64> {
    let n = g.len();
    let posterior = (f + DMatrix::identity(n, n) * s.powi(-2)).cholesky()?;
    let quadratic = 0.5 * g.dot(&posterior.solve(g));
    Some(quadratic - 0.5 * ln_det(&posterior) - n as f64 * s.ln())
}

/// Logarithm of the mean of evidences that are given by their logarithms.
pub fn mean_evidence<const N: usize>(ln: [f64; N]) -> f64 {
    let most = ln.iter().copied().fold(f64::MIN, f64::max);
    most + (ln.iter().map(|x| (x - most).exp()).sum::<f64>() / N as f64).ln()
}

/// The best gain of some directions next to one another: the first, and how many.
fn gain_along(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    (first, n): (usize, usize),
    widths: &[f64],
) -> f64 {
    let f = information.view((first, first), (n, n)).into_owned();
    best_gain(&f, &gradient.rows(first, n).into_owned(), widths).0
}

fn solution(f: &DMatrix<f64>, g: &DVector<f64>, s: f64) -> (Vec<f64>, Vec<f64>) {
    let n = g.len();
    let posterior = f + DMatrix::identity(n, n) * s.powi(-2);
    posterior.try_inverse().map_or_else(
        || (vec![0.0; n], vec![s; n]),
        |covariance| {
            let mean = &covariance * g;
            let sigma = covariance.diagonal().map(|x| x.max(0.0).sqrt());
            (mean.iter().copied().collect(), sigma.iter().copied().collect())
        },
    )
}

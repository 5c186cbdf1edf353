//! The nominal numbers from nominal flights.

use bench_filter::{Coordinate, Noise, PerNumber, Point, Prediction, RigNumber, Track, innovations};
use bench_inference::{Fit, Problem};
use bench_rig::{GRAVITY_M_S2, Rig, Uncertain};
use bench_statistics::mean;
use serde::Serialize;

use crate::{
    blocks::Block,
    error::IdentifyError,
    laws::NominalLaw,
    noise, plausible,
    spread::{Says, between_flights, common_information},
};

/// A standard error above this share of the tolerance before is no news.
const IDENTIFIED: f64 = 0.8;
/// The noise and the numbers are fitted in turn so often at most.
const ROUNDS: usize = 4;
/// A round that moves no flight's noise by more is the last, natural logarithm.
const SETTLED_LN: f64 = 0.05;

/// What nominal flights tell of a rig. As JSON it is `bench.identification/1` (docs/identify.md).
#[derive(Clone, Debug, Serialize)]
pub struct FlightIdentification {
    /// `bench.identification/1`.
    pub schema: &'static str,
    /// The rig's numbers, before and after.
    pub numbers: Vec<IdentifiedNumber>,
    /// Laws of the library that were found to belong to the model, in the order in which they were found.
    pub laws: Vec<NominalLaw>,
    /// One sigma of a measurement without rounding, m: before and after.
    pub tracker_noise_m: [f64; 2],
    /// White acceleration, m/s^2 per root Hz.
    pub white_m_s2_per_root_hz: f64,
    /// One sigma of the exposures' times, s.
    pub timing_s: f64,
    /// Share of measurements that show a wrong place, and one sigma of how wrong, m.
    pub outliers: (f64, f64),
    /// One sigma of the turbulence's acceleration, m/s^2.
    pub turbulence_m_s2: f64,
    /// For how long it remembers, s.
    pub turbulence_time_s: f64,
    /// One sigma of the acceleration that a flight keeps, m/s^2.
    pub trim_m_s2: f64,
    /// Its random walk within a flight, m/s^2 per root s.
    pub trim_walk_m_s2_per_root_s: f64,
    /// One sigma of the natural logarithm by which noise differs from flight to flight.
    pub noise_spread_ln: f64,
    /// Mean of squared innovations over their variance; 1 for a right model.
    pub mean_nis: f64,
    /// Correlation of neighbouring innovations, normalised; 0 for a right model.
    pub autocorrelation: f64,
    /// The flights with the measurements that were held against a prediction.
    pub flights: Vec<(String, usize)>,
    /// What could not be used, or should be known.
    pub warnings: Vec<String>,
    /// The rig with the numbers found.
    #[serde(skip)]
    pub rig: Rig,
    /// Flights left out, each block with the model of the others; empty where there are fewer than [`crate::LEAST_FLIGHTS`], and
    /// where that was not asked for.
    #[serde(skip)]
    pub blocks: Vec<Block>,
}

impl FlightIdentification {
    /// Whether neighbouring innovations are uncorrelated: within two standard deviations of what white ones show (Bartlett).
    pub fn is_white(&self) -> bool {
        let measurements: usize = self.flights.iter().map(|(_, measurements)| measurements).sum();
        self.autocorrelation.abs() < 2.0 / (measurements.max(1) as f64).sqrt()
    }
}

/// One of the rig's numbers, before and after.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IdentifiedNumber {
    /// Which, without the rig's own units.
    pub name: &'static str,
    /// Value and one sigma that the rig gave.
    pub before: (f64, f64),
    /// Value and one sigma that the new rig gives.
    pub after: (f64, f64),
    /// One sigma of what all flights have in common.
    pub standard_error: f64,
    /// One sigma between flights.
    pub between_flights: f64,
    /// Whether the flights tell it: if not, it is left as it was.
    pub identified: bool,
}

/// Fits a rig's numbers to flights that are known to be nominal, keeping its tolerances as priors.
pub fn identify_flights(tracks: &[Track], rig: &Rig) -> Result<FlightIdentification, IdentifyError> {
    plausible::before(tracks, rig)?;
    let mut prior = with_hover(rig);
    let mut tracks = tracks.to_vec();
    let noise = settle(&mut tracks, &mut prior);
    let problem = Problem { noise, ..Problem::new(&tracks, &prior) };
    let fit = problem.refine(problem.nominal.clone(), noise);
    plausible::after(&problem, &fit)?;

    let told = Told::of(&problem, &fit);
    // What is left as it was is held there while the others are fitted again, so that they belong together.
    let mut rest = Problem { nominal: problem.nominal.clone(), ..problem };
    for number in RigNumber::ALL {
        if number != RigNumber::Origin && !told.identified[number] {
            rest.sigma[number] = 0.0;
        }
    }
    if told.identified[RigNumber::Latency] && fit.point.nuisances[RigNumber::Latency] < 0.0 {
        rest.nominal.nuisances[RigNumber::Latency] = 0.0;
        rest.sigma[RigNumber::Latency] = 0.0;
    }
    let fit = rest.refine(rest.nominal.clone(), rest.noise);
    Ok(tell(&problem, &told, &fit, rig, &prior))
}

/// The same rig with the throttle that hovers instead of the gain as the number with a tolerance. Gain and offset make
/// up for one another in flights, which hold the throttle near hover; hover and offset do not. With
/// `range = weight/gain`, `hover = offset + range` and `s` the relative tolerance of `weight/gain`:
///
/// ```text
/// sigma(hover)^2 = sigma(offset)^2 + (range s)^2
/// 1/sigma(offset given hover)^2 = 1/sigma(offset)^2 + 1/(range s)^2
/// ```
fn with_hover(rig: &Rig) -> Rig {
    let mut out = rig.clone();
    let a = &rig.airframe;
    let relative = |x: Uncertain| x.sigma / x.value;
    let range = a.weight_n() / a.thrust.gain_n_per_unit.value;
    let from_gain = range * relative(a.thrust.gain_n_per_unit).hypot(relative(a.mass_kg));
    let from_offset = a.thrust.offset.sigma;
    if a.thrust.hover_sigma.is_none() && from_gain > 0.0 && from_offset > 0.0 {
        out.airframe.thrust.hover_sigma = Some(from_offset.hypot(from_gain));
        out.airframe.thrust.offset.sigma = (from_offset.powi(-2) + from_gain.powi(-2)).powf(-0.5);
    }
    out
}

/// Spread of the noise between flights before any was seen.
const NOISE_SPREAD_LN: f64 = 0.5;
/// A few flights that are alike do not show that all are: what was thought before counts as so many of them.
const THOUGHT_FLIGHTS: f64 = 3.0;

/// Fits numbers, noise and each flight's share of it in turn; the noise. The spread of the shares goes into the rig.
fn settle(tracks: &mut [Track], prior: &mut Rig) -> Noise {
    let spread = prior.disturbance.noise_spread_ln.unwrap_or(NOISE_SPREAD_LN);
    prior.disturbance.noise_spread_ln = Some(spread);
    let thought = noise::thought(&Problem::new(tracks, prior).noise);
    let (mut noise, mut pooled_noise) = (thought, thought);
    let mut point = Problem::new(tracks, prior).nominal;
    for _ in 0..ROUNDS {
        let problem = Problem { noise, ..Problem::new(tracks, prior) };
        let fit = problem.refine(point, noise);
        noise = noise::most_likely(&problem, &fit, &thought);
        // The same of what a flight keeps: three flights of one battery do not show what the next has.
        let flights = tracks.len() as f64;
        let pooled = |found: f64, before: f64| {
            ((flights * found * found + THOUGHT_FLIGHTS * before * before) / (flights + THOUGHT_FLIGHTS))
                .sqrt()
        };
        let kept = Noise {
            trim: pooled(noise.trim, thought.trim),
            trim_walk: pooled(noise.trim_walk, thought.trim_walk),
            ..noise
        };
        let fit = Fit { noise: kept, ..fit };
        let levels = problem.level(&fit);
        // The noise is that of the usual flight; the shares lie about it.
        let n = levels.len() as f64;
        let mean = levels.iter().sum::<f64>() / n;
        let squares: f64 = levels.iter().map(|ln| (ln - mean).powi(2)).sum();
        let found = ((squares + THOUGHT_FLIGHTS * spread * spread) / (n + THOUGHT_FLIGHTS)).sqrt();
        let moved = tracks.iter().zip(&levels).map(|(track, ln)| (track.ln_noise - ln + mean).abs());
        let settled = moved.fold(0.0, f64::max) < SETTLED_LN;
        for (track, ln) in tracks.iter_mut().zip(levels) {
            track.ln_noise = ln - mean;
        }
        prior.disturbance.noise_spread_ln = Some(found);
        point = fit.point;
        pooled_noise = kept;
        if settled {
            break;
        }
    }
    pooled_noise
}

/// Correlation of neighbouring innovations, each over its standard deviation and less its flight's mean; 0 of none.
fn autocorrelation(predicted: &[Prediction]) -> f64 {
    let (mut together, mut alone) = (0.0, 0.0);
    for flight in predicted {
        let normed: Vec<f64> =
            flight.innovations.iter().map(|i| i.residual_m / i.variance_m2.sqrt()).collect();
        let mean = normed.iter().sum::<f64>() / normed.len().max(1) as f64;
        together += normed.windows(2).map(|pair| (pair[0] - mean) * (pair[1] - mean)).sum::<f64>();
        alone += normed.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
    }
    if alone > 0.0 { together / alone } else { 0.0 }
}

/// How well the flights tell each of the nuisances.
struct Told {
    standard_error: PerNumber<f64>,
    between: PerNumber<f64>,
    identified: PerNumber<bool>,
}

impl Told {
    fn of(problem: &Problem<'_>, fit: &Fit) -> Self {
        let own: Vec<Option<RigNumber>> = fit
            .free
            .iter()
            .map(|f| match f.at {
                Coordinate::Nuisance(number) => Some(number),
                Coordinate::Effect { .. } => None,
            })
            .collect();
        let says: Vec<Says> = fit
            .pass
            .tracks
            .iter()
            .map(|track| Says { gradient: track.gradient.clone(), information: track.information.clone() })
            .collect();
        let prior: Vec<f64> = fit.free.iter().map(|f| f.sigma).collect();
        // The tracker's origin and the mass are no matter of the flight.
        let alike = [None, Some(RigNumber::Mass), Some(RigNumber::Origin)];
        let differs: Vec<bool> = own.iter().map(|number| !alike.contains(number)).collect();
        let tau = between_flights(&says, &prior, &differs);
        let mut information = common_information(&says, &tau);
        for (i, sigma) in prior.iter().enumerate() {
            information[(i, i)] += sigma.powi(-2);
        }
        let mut told = Self {
            standard_error: problem.sigma,
            between: PerNumber::default(),
            identified: PerNumber::default(),
        };
        if let Some(covariance) = information.try_inverse() {
            for (k, number) in own.iter().enumerate().filter_map(|(k, number)| Some((k, (*number)?))) {
                told.standard_error[number] = covariance[(k, k)].max(0.0).sqrt();
                told.between[number] = tau[k];
                told.identified[number] = told.standard_error[number] < IDENTIFIED * problem.sigma[number];
            }
        }
        told
    }
}

fn tell(problem: &Problem<'_>, told: &Told, fit: &Fit, rig: &Rig, prior: &Rig) -> FlightIdentification {
    let n = &fit.point.nuisances;
    let mut out = prior.clone();
    let thrust = &mut out.airframe.thrust;
    let range = prior.airframe.weight_n() / prior.airframe.thrust.gain_n_per_unit.value;
    let mut between = told.between;
    if thrust.hover_sigma.is_some() {
        // Another battery is another trim: to the throttle that hovers it is a shift.
        between[RigNumber::ThrustGain] =
            between[RigNumber::ThrustGain].hypot(problem.noise.trim / GRAVITY_M_S2 * range);
    }
    let sigma = |i: RigNumber| told.standard_error[i].hypot(between[i]);
    let set = |number: &mut Uncertain, i: RigNumber, before: Uncertain, low: f64| {
        *number =
            if told.identified[i] { Uncertain { value: n[i].max(low), sigma: sigma(i) } } else { before };
    };
    set(&mut thrust.offset, RigNumber::ThrustOffset, rig.airframe.thrust.offset, f64::MIN);
    if thrust.hover_sigma.is_some() {
        if told.identified[RigNumber::ThrustGain] {
            let range = n[RigNumber::ThrustGain] - thrust.offset.value;
            thrust.hover_sigma = Some(sigma(RigNumber::ThrustGain));
            thrust.gain_n_per_unit.value = prior.airframe.weight_n() / range;
            thrust.gain_n_per_unit.sigma = thrust.gain_n_per_unit.value
                * sigma(RigNumber::ThrustGain).hypot(thrust.offset.sigma)
                / range;
        } else {
            *thrust = rig.airframe.thrust;
        }
    } else {
        set(
            &mut thrust.gain_n_per_unit,
            RigNumber::ThrustGain,
            rig.airframe.thrust.gain_n_per_unit,
            f64::MIN_POSITIVE,
        );
    }
    let ground = &mut out.airframe.ground_effect;
    set(
        &mut ground.multiplier,
        RigNumber::GroundEffectMultiplier,
        rig.airframe.ground_effect.multiplier,
        1.0,
    );
    set(&mut ground.height_m, RigNumber::GroundEffectHeight, rig.airframe.ground_effect.height_m, 1e-3);
    set(&mut out.airframe.drag_n_s_per_m, RigNumber::Drag, rig.airframe.drag_n_s_per_m, 0.0);
    set(&mut out.tracker.latency_s, RigNumber::Latency, rig.tracker.latency_s, 0.0);
    let noise = &fit.noise;
    let rounding = rig.tracker.resolution_m / 12_f64.sqrt();
    out.tracker.noise_m = (noise.measurement_m.powi(2) - rounding * rounding).max(0.0).sqrt();
    out.disturbance.turbulence_m_s2 = Some(noise.turbulence);
    out.disturbance.turbulence_time_s = Some(noise.turbulence_time_s);
    out.disturbance.white_m_s2_per_root_hz = Some(noise.acceleration);
    out.disturbance.timing_s = Some(noise.jitter_s);
    out.disturbance.outlier_probability = Some(noise.outlier_probability);
    out.disturbance.outlier_m = Some(noise.outlier_m);
    out.disturbance.trim_m_s2 = Some(noise.trim);
    out.disturbance.trim_walk_m_s2_per_root_s = Some(noise.trim_walk);
    let felt = |sigma: f64| (sigma > 0.0).then_some(sigma);
    out.disturbance.velocity_noise_m_s = felt(noise.velocity_m_s);
    out.disturbance.acceleration_noise_m_s2 = felt(noise.acceleration_m_s2);

    let (before, _) = Point::nominal(prior);
    let (after, after_sigma) = Point::nominal(&out);
    let names = Point::names(prior);
    let numbers = problem
        .uncertain()
        .filter(|(i, _)| *i != RigNumber::Origin)
        .map(|(i, sigma)| IdentifiedNumber {
            name: names[i],
            before: (before.nuisances[i], sigma),
            after: (after.nuisances[i], after_sigma[i]),
            standard_error: told.standard_error[i],
            between_flights: between[i],
            identified: told.identified[i],
        })
        .collect();
    let predicted = problem.predict(&fit.point, noise);
    let flights = problem.tracks.iter().map(|track| (track.name.clone(), track.counted())).collect();
    FlightIdentification {
        schema: "bench.identification/1",
        numbers,
        laws: Vec::new(),
        tracker_noise_m: [rig.tracker.noise_m, out.tracker.noise_m],
        white_m_s2_per_root_hz: noise.acceleration,
        timing_s: noise.jitter_s,
        outliers: (noise.outlier_probability, noise.outlier_m),
        turbulence_m_s2: noise.turbulence,
        turbulence_time_s: noise.turbulence_time_s,
        trim_m_s2: noise.trim,
        trim_walk_m_s2_per_root_s: noise.trim_walk,
        noise_spread_ln: out.disturbance.noise_spread_ln.unwrap_or_default(),
        mean_nis: mean(innovations(&predicted).map(|i| i.residual_m.powi(2) / i.variance_m2)).unwrap_or(0.0),
        autocorrelation: autocorrelation(&predicted),
        flights,
        warnings: Vec::new(),
        rig: out,
        blocks: Vec::new(),
    }
}

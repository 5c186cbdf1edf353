//! How altitude follows throttle, by a regression in weak form.
//!
//! With a test function `f` that vanishes with its slope at both ends of a window, integration by parts frees the altitude `z` from
//! differentiation, and so from most of its noise (Messenger and Bortz, Weak `SINDy`, Multiscale Modeling & Simulation 19(3), 2021):
//!
//! ```text
//! z'' = k u(t - lag) - d z' - c    becomes    integral z f'' = k integral u(t - lag) f + d integral z f' - c integral f
//! ```
//! `c` is each flight's own and goes with time, for batteries differ and run down. `k` and `d` are found by least squares for each lag
//! of a grid; the lag that explains most is taken.

use bench_statistics::median;

use super::{Flown, Sightings};

/// What flights tell of throttle and acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Response {
    /// How many flights told it.
    pub flights: usize,
    /// By how much the acceleration follows the throttle, s; `None` where it is not told.
    pub lag_s: Option<f64>,
    /// Correlation of throttle and acceleration at that lag.
    pub correlation: f64,
    /// Acceleration per unit of throttle, m/s^2 per unit; `None` where it is not told.
    pub slope: Option<Told>,
    /// The throttle that hovers, the median over the flights.
    pub hover: f64,
    /// One sigma of it between flights.
    pub hover_spread: f64,
}

/// A number and its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Told {
    pub value: f64,
    pub sigma: f64,
}

/// Lags that are tried, from the first to the last, and how far apart, s.
const LAGS_S: (f64, f64, f64) = (-0.1, 0.4, 0.005);
/// A window is so long, s, and holds so many frames at least.
const WINDOW_S: f64 = 0.8;
const LEAST_FRAMES: f64 = 10.0;
/// Throttle is looked up so often in a window.
const LOOK_UPS: u32 = 64;
/// So many windows are needed for two numbers.
const LEAST_WINDOWS: usize = 12;
/// The slope must be so many standard errors above zero.
const PLAIN: f64 = 4.0;
/// The correlation must be so large.
const LEAST_CORRELATION: f64 = 0.4;

/// A window's weighted means.
struct Window {
    flight: usize,
    /// Its middle, s.
    time_s: f64,
    acceleration: f64,
    velocity: f64,
    /// One for each lag.
    throttle: Vec<f64>,
}

impl Response {
    pub fn of(flown: &[Flown], sightings: &Sightings) -> Self {
        let lags: Vec<f64> = {
            let (first, last, step) = LAGS_S;
            // Nothing is seen before it is exposed.
            let first = first.max(-sightings.age_s);
            let count = ((last - first) / step).round() as u32;
            (0..=count).map(|k| first + f64::from(k) * step).collect()
        };
        let length_s = WINDOW_S.max(LEAST_FRAMES * sightings.row_s);
        let windows: Vec<Window> =
            flown.iter().enumerate().flat_map(|(flight, of)| windows(of, flight, length_s, &lags)).collect();
        let fits: Vec<Fit> = (0..lags.len()).map(|lag| Fit::of(&windows, flown.len(), lag)).collect();
        let best = (0..lags.len()).max_by(|a, b| fits[*a].explained.total_cmp(&fits[*b].explained));
        let told = best.filter(|best| fits[*best].is_told() && (1..lags.len() - 1).contains(best));
        let of_aloft = |of: &Flown| {
            let aloft = of
                .seen
                .iter()
                .filter(|[time, _]| of.aloft.iter().any(|[from, to]| (*from..=*to).contains(time)));
            median(aloft.filter_map(|[time, _]| of.throttle_at(*time)))
        };
        let medians: Vec<f64> = flown.iter().filter_map(of_aloft).collect();
        let hovers = match told {
            Some(best) => fits[best].hovers(&windows, flown.len(), best),
            None => Vec::new(),
        };
        let hovers = if hovers.is_empty() { medians } else { hovers };
        let hover = median(hovers.iter().copied()).unwrap_or(f64::NAN);
        let spread = {
            let squares: f64 = hovers.iter().map(|one| (one - hover).powi(2)).sum();
            (squares / (hovers.len().max(2) - 1) as f64).sqrt()
        };
        Self {
            flights: hovers.len(),
            lag_s: told.map(|best| refined(&fits, &lags, best)),
            correlation: told.map_or(0.0, |best| fits[best].explained.sqrt()),
            slope: told.map(|best| Told { value: fits[best].slope, sigma: fits[best].slope_error }),
            hover,
            hover_spread: spread,
        }
    }
}

/// The top of a parabola through the best lag and its neighbours.
fn refined(fits: &[Fit], lags: &[f64], best: usize) -> f64 {
    let [before, top, after] = [best - 1, best, best + 1].map(|lag| fits[lag].explained);
    let curvature = before - 2.0 * top + after;
    let shift = if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 };
    lags[best] + shift * LAGS_S.2
}

/// `(1 - s^2)^4` with its first and second derivative, for `s` from -1 to 1.
fn bump(s: f64) -> [f64; 3] {
    let q = 1.0 - s * s;
    [q.powi(4), -8.0 * s * q.powi(3), 48.0 * s * s * q * q - 8.0 * q.powi(3)]
}

fn windows(flown: &Flown, flight: usize, length_s: f64, lags: &[f64]) -> Vec<Window> {
    let half = 0.5 * length_s;
    let mut found = Vec::new();
    for [from, to] in &flown.aloft {
        let count = ((to - from) / half) as u32;
        for middle in (1..count).map(|k| from + f64::from(k) * half) {
            found.extend(window(flown, flight, middle, half, lags));
        }
    }
    found
}

fn window(flown: &Flown, flight: usize, middle: f64, half: f64, lags: &[f64]) -> Option<Window> {
    const LEAST_SEEN: usize = 6;
    /// A gap that is a larger share of half a window spoils it.
    const WIDEST_GAP: f64 = 0.5;
    let first = flown.seen.partition_point(|[time, _]| *time < middle - half);
    let last = flown.seen.partition_point(|[time, _]| *time <= middle + half);
    let seen = &flown.seen[first..last];
    let gap = seen.windows(2).map(|pair| pair[1][0] - pair[0][0]).fold(0.0, f64::max);
    let [begin, end] = [seen.first()?[0] - (middle - half), middle + half - seen.last()?[0]];
    if seen.len() < LEAST_SEEN || gap.max(begin).max(end) > WIDEST_GAP * half {
        return None;
    }
    // What all altitudes have in common has no slope; without it rounding of the sums matters less.
    let mean = seen.iter().map(|[_, z]| z).sum::<f64>() / seen.len() as f64;
    let (mut acceleration, mut velocity) = (0.0, 0.0);
    for pair in seen.windows(2) {
        let step = pair[1][0] - pair[0][0];
        for [time, z] in pair {
            let [_, slope, curvature] = bump((time - middle) / half);
            acceleration += 0.5 * step * (z - mean) * curvature / (half * half);
            velocity -= 0.5 * step * (z - mean) * slope / half;
        }
    }
    let places = (0..LOOK_UPS).map(|k| (2.0 * f64::from(k) + 1.0) / f64::from(LOOK_UPS) - 1.0);
    let weights: Vec<[f64; 2]> = places.map(|s| [middle + s * half, bump(s)[0]]).collect();
    let sum: f64 = weights.iter().map(|[_, weight]| weight).sum();
    let throttle = lags
        .iter()
        .map(|lag| {
            let weighted = weights.iter().map(|[time, weight]| Some(flown.throttle_at(time - lag)? * weight));
            weighted.sum::<Option<f64>>().map(|total| total / sum)
        })
        .collect::<Option<Vec<f64>>>()?;
    let area = sum * 2.0 * half / f64::from(LOOK_UPS);
    Some(Window {
        flight,
        time_s: middle,
        acceleration: acceleration / area,
        velocity: velocity / area,
        throttle,
    })
}

/// The regression at one lag.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    slope: f64,
    slope_error: f64,
    damping: f64,
    /// Share of the acceleration's variance within flights that the throttle explains.
    explained: f64,
}

impl Fit {
    fn of(windows: &[Window], flights: usize, lag: usize) -> Self {
        if windows.len() < LEAST_WINDOWS + 2 * flights {
            return Self::default();
        }
        let trends = trends(windows, flights, lag);
        let [mut uu, mut uv, mut vv, mut ua, mut va, mut aa] = [0.0; 6];
        for window in windows {
            let [u, v, a] = trends[window.flight].without(window, lag);
            uu += u * u;
            uv += u * v;
            vv += v * v;
            ua += u * a;
            va += v * a;
            aa += a * a;
        }
        let determinant = uu * vv - uv * uv;
        if !(determinant > 1e-9 * uu * vv && aa > 0.0) {
            return Self::default();
        }
        let slope = (ua * vv - va * uv) / determinant;
        let damping = (ua * uv - va * uu) / determinant;
        let left = (aa - slope * ua + damping * va).max(0.0);
        let free = (windows.len() - 2 * flights).saturating_sub(2).max(1) as f64;
        // Windows overlap by half, so that there are half as many.
        let slope_error = (2.0 * left / free * vv / determinant).sqrt();
        // Speed alone explains nothing that the throttle does.
        let by_speed = va * va / vv;
        Self { slope, slope_error, damping, explained: ((aa - left - by_speed) / aa).clamp(0.0, 1.0) }
    }

    fn is_told(&self) -> bool {
        self.slope > PLAIN * self.slope_error && self.explained.sqrt() > LEAST_CORRELATION
    }

    /// The throttle at which each flight neither rises nor sinks, in its middle.
    fn hovers(&self, windows: &[Window], flights: usize, lag: usize) -> Vec<f64> {
        let of = |trend: &Trend| {
            let [u, v, a] = trend.mean;
            u - (a + self.damping * v) / self.slope
        };
        trends(windows, flights, lag).iter().map(of).filter(|hover| hover.is_finite()).collect()
    }
}

/// A straight line in time through throttle, velocity and acceleration of a flight's windows, in this order.
#[derive(Clone, Copy, Debug, Default)]
struct Trend {
    /// The windows' mean time, s.
    time_s: f64,
    mean: [f64; 3],
    per_s: [f64; 3],
}

impl Trend {
    fn without(&self, window: &Window, lag: usize) -> [f64; 3] {
        let since_s = window.time_s - self.time_s;
        let values = values(window, lag);
        [0, 1, 2].map(|k| values[k] - self.mean[k] - since_s * self.per_s[k])
    }
}

fn values(window: &Window, lag: usize) -> [f64; 3] {
    [window.throttle[lag], window.velocity, window.acceleration]
}

/// One for each flight; NaN of a flight without windows.
fn trends(windows: &[Window], flights: usize, lag: usize) -> Vec<Trend> {
    let of = |flight: usize| {
        let own = || windows.iter().filter(move |window| window.flight == flight);
        let count = own().count() as f64;
        let time_s = own().map(|window| window.time_s).sum::<f64>() / count;
        let mean = [0, 1, 2].map(|k| own().map(|window| values(window, lag)[k]).sum::<f64>() / count);
        let square: f64 = own().map(|window| (window.time_s - time_s).powi(2)).sum();
        let per_s = [0, 1, 2].map(|k| {
            let product: f64 = own().map(|window| (window.time_s - time_s) * values(window, lag)[k]).sum();
            if square > 0.0 { product / square } else { 0.0 }
        });
        Trend { time_s, mean, per_s }
    };
    (0..flights).map(of).collect()
}

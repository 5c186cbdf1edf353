//! What the altitudes themselves tell of who measured them.

use bench_recording::Flight;
use bench_statistics::median;

use super::{Flown, Source, rounded};

/// How a position source measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sightings {
    /// From exposure to arrival, as the log or its map has it, s.
    pub age_s: f64,
    /// Time between two sightings whose errors are independent, s.
    pub frame_period_s: f64,
    /// Time between two rows, s.
    pub row_s: f64,
    /// Steps of the altitude, m; 0: none.
    pub resolution_m: f64,
    /// One sigma of the noise besides, m.
    pub noise_m: f64,
    /// Share of frames that are missing.
    pub dropouts: f64,
}

/// Rows that are closer have errors that follow one another, as those of estimators and of motion capture do, s.
const DENSE_S: f64 = 0.02;
/// So far apart errors of dense rows are taken as independent, s.
const FORGOTTEN_S: f64 = 0.1;
/// One sigma of the error of dense rows, m, where the rows tell less.
const DENSE_NOISE_M: f64 = 0.001;
/// A tracker that is better shakes with the airframe, m.
const LEAST_NOISE_M: f64 = 0.0003;
/// Deviation of a normal distribution over its median absolute deviation.
const PER_MAD: f64 = 1.4826;

impl Sightings {
    pub fn of(flights: &[&Flight], flown: &[Flown]) -> Self {
        let ages = flights.iter().flat_map(|flight| {
            flight.positions.iter().map(|position| position.arrived_at.since_s(position.exposed_at))
        });
        let gaps = || flown.iter().flat_map(|of| of.seen.windows(2).map(|pair| pair[1][0] - pair[0][0]));
        let row_s = median(gaps()).unwrap_or(FORGOTTEN_S).clamp(0.001, 1.0);
        let resolution_m = flown.iter().find_map(|of| step(&of.seen)).unwrap_or(0.0);
        let is_dense = row_s < DENSE_S;
        let rounding_m = resolution_m / 12_f64.sqrt();
        let noise_m = (noise(flown, row_s).powi(2) - rounding_m * rounding_m).max(0.0).sqrt();
        let noise_m = noise_m.max(if is_dense { DENSE_NOISE_M } else { LEAST_NOISE_M });
        // A frame that is missing leaves a gap of two periods.
        let missed =
            gaps().map(|gap| (gap / row_s).round() - 1.0).filter(|missed| (1.0..10.0).contains(missed));
        let missing = missed.fold(0.0, |sum, missed| sum + missed);
        let frames = gaps().count() as f64 + missing;
        Self {
            age_s: rounded(median(ages).unwrap_or(0.0).clamp(0.0, 1.0)),
            frame_period_s: rounded(if is_dense { FORGOTTEN_S } else { row_s }),
            row_s,
            resolution_m,
            noise_m: noise_m.min(0.1),
            dropouts: if frames > 0.0 { missing / frames } else { 0.0 },
        }
    }

    /// Whether rows come faster than their errors change.
    const fn is_dense(&self) -> bool {
        self.row_s < DENSE_S
    }

    pub const fn source(&self) -> Source {
        if self.is_dense() { Source::Guess } else { Source::Flights }
    }

    pub fn period_words(&self) -> String {
        if self.is_dense() {
            format!(
                "rows come every {:.4} s, faster than the errors of an estimator or a motion capture change; so far apart they are taken as \
                 independent",
                self.row_s
            )
        } else {
            "the median time between two sightings".to_owned()
        }
    }

    pub const fn noise_words(&self) -> &'static str {
        if self.is_dense() {
            "the third differences of the altitude, 1 mm at least: of rows so close they do not show slow errors"
        } else {
            "the third differences of the altitude, less rounding; 0.3 mm at least"
        }
    }
}

/// One sigma of white noise by third differences, in which smooth motion cancels: their variance is 1 + 9 + 9 + 1 times that of one
/// altitude. Zero where there are none.
fn noise(flown: &[Flown], row_s: f64) -> f64 {
    let mut sizes = Vec::new();
    for of in flown {
        let is_aloft = |time: f64| of.aloft.iter().any(|[from, to]| (*from..=*to).contains(&time));
        for four in of.seen.windows(4) {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| four[k]);
            let regular = ((d[0] - a[0]) / (3.0 * row_s) - 1.0).abs() < 0.2;
            if regular && is_aloft(a[0]) && is_aloft(d[0]) {
                sizes.push((d[1] - 3.0 * c[1] + 3.0 * b[1] - a[1]).abs());
            }
        }
    }
    PER_MAD * median(sizes).unwrap_or(0.0) / 20_f64.sqrt()
}

/// The step in which altitudes come, m; `None` where they come in none.
pub(super) fn step(seen: &[[f64; 2]]) -> Option<f64> {
    /// Altitudes that agree to this are one, m: a float of some metres is not better.
    const SAME_M: f64 = 2e-6;
    const LEAST_PLACES: usize = 8;
    /// So few of the altitudes are different ones.
    const FEW: usize = 3;
    let mut places: Vec<f64> = seen.iter().map(|[_, z]| *z).collect();
    places.sort_by(f64::total_cmp);
    places.dedup_by(|next, before| *next - *before < SAME_M);
    if places.len() < LEAST_PLACES || FEW * places.len() > seen.len() {
        return None;
    }
    let gaps: Vec<f64> = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let step = median(gaps.iter().copied())?;
    let fits = gaps.iter().filter(|gap| (*gap / step - (*gap / step).round()).abs() < 0.05).count();
    (20 * fits > 19 * gaps.len() && step <= 0.1).then(|| rounded(step))
}

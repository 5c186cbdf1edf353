//! Where the world is what the filter believes, its innovations are white, of the variance that it says: their normalised
//! squares sum to a chi-squared variable (Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, section 5.4).

#[path = "../../diagnosis/tests/support/flown.rs"]
mod flown;
#[path = "../../diagnosis/tests/support/mod.rs"]
mod support;

use bench_filter::{NEAR_GROUND_M, Noise, Point, Track, predict};
use bench_plant::effects::{Axis, parse_effect};
use bench_rig::Rig;
use flown::fly;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};
use support::rig;

/// Deviation, m/s, and correlation time, s, of the wind in which all flights are flown.
const WIND: (f64, f64) = (0.15, 0.5);
const FLIGHTS: u64 = 30;
/// Chance of a false alarm of each check, to either side.
const CHANCE: f64 = 1e-4;

/// The rig as it is, and as the filter is told that it is: all that disturbs it is wind.
fn real_and_told() -> [Rig; 2] {
    let mut told = rig();
    // Rounding is not normal.
    told.tracker.resolution_m = 0.0;
    let a = &told.airframe;
    told.disturbance.turbulence_m_s2 = Some(WIND.0 * a.drag_n_s_per_m.value / a.mass_kg.value);
    told.disturbance.turbulence_time_s = Some(WIND.1);
    told.disturbance.white_m_s2_per_root_hz = Some(0.0);
    told.disturbance.trim_walk_m_s2_per_root_s = Some(0.0);
    told.disturbance.trim_m_s2 = Some(0.0);
    let mut real = told.clone();
    real.effects
        .push(parse_effect(&format!("gusts:sigma_m_s={},correlation_time_s={}", WIND.0, WIND.1)).unwrap());
    [real, told]
}

/// Normalised innovations of each flight at altitude: near the ground the filter allows for a law with a kink.
fn normalised() -> Vec<Vec<f64>> {
    let [real, told] = real_and_told();
    let (point, _) = Point::nominal(&told);
    let noise = Noise::nominal(&told);
    (1..=FLIGHTS)
        .map(|seed| {
            let track = Track::from_flight("steps", &fly(&real, "steps", seed), &told).unwrap();
            predict(&track, &told, &point, &noise)
                .innovations
                .iter()
                .filter(|innovation| innovation.axes[Axis::Altitude as usize] > 2.0 * NEAR_GROUND_M)
                .map(|innovation| innovation.residual_m / innovation.variance_m2.sqrt())
                .collect()
        })
        .collect()
}

#[test]
fn normalised_innovations_squared_sum_to_a_chi_squared_variable_and_neighbours_do_not_correlate() {
    let flights = normalised();
    let squares: f64 = flights.iter().flatten().map(|x| x * x).sum();
    let count = flights.iter().map(Vec::len).sum::<usize>();
    let expected = ChiSquared::new(count as f64).unwrap();
    let [low, high] = [CHANCE, 1.0 - CHANCE].map(|p| expected.inverse_cdf(p));
    assert!(count > 5000, "{count}");
    assert!((low..high).contains(&squares), "{squares} of {count}: {low} to {high}");

    // Of white noise the mean product of neighbours is normal with variance 1/n.
    let products: f64 =
        flights.iter().flat_map(|flight| flight.windows(2)).map(|pair| pair[0] * pair[1]).sum();
    let pairs = (count - flights.len()) as f64;
    assert!(
        (products / pairs).abs() < Normal::standard().inverse_cdf(1.0 - CHANCE) / pairs.sqrt(),
        "{}",
        products / pairs
    );
}

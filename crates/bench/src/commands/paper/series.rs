//! Series of a flight that figures and statements are made of.

use bench_device::TrackStatus;
use bench_recording::Flight;
use bench_rig::Phase;

/// Altitude as seen, over the time of exposure, s and m.
pub fn seen(flight: &Flight) -> Vec<(f64, f64)> {
    let found = flight.positions.iter().filter(|p| p.status != TrackStatus::Lost);
    found.map(|p| (p.exposed_at.seconds(), p.position_m[2])).collect()
}

/// Altitude as it was, s and m.
pub fn true_altitude(flight: &Flight) -> Vec<(f64, f64)> {
    flight.truth.iter().map(|t| (t.time.seconds(), t.position_m[2])).collect()
}

/// Vertical speed as it was, s and m/s.
pub fn true_speed(flight: &Flight) -> Vec<(f64, f64)> {
    flight.truth.iter().map(|t| (t.time.seconds(), t.velocity_m_s[2])).collect()
}

/// Slope of what was seen over 0.2 s, s and m/s.
pub fn seen_speed(flight: &Flight) -> Vec<(f64, f64)> {
    const HALF_S: f64 = 0.1;
    let z = seen(flight);
    z.iter()
        .filter_map(|(t, _)| {
            let from = z.partition_point(|(time, _)| *time < t - HALF_S - 1e-6);
            let to = z.partition_point(|(time, _)| *time <= t + HALF_S + 1e-6);
            let window = &z[from..to];
            let n = window.len() as f64;
            let mean_t = window.iter().map(|(t, _)| t).sum::<f64>() / n;
            let mean_z = window.iter().map(|(_, z)| z).sum::<f64>() / n;
            let over: f64 = window.iter().map(|(t, z)| (t - mean_t) * (z - mean_z)).sum();
            let under: f64 = window.iter().map(|(t, _)| (t - mean_t).powi(2)).sum();
            (window.len() > 3 && under > 0.0).then(|| (*t, over / under))
        })
        .collect()
}

/// Values over the last 6 s of the hold of a flight.
pub fn settled(flight: &Flight, values: &[(f64, f64)]) -> Vec<f64> {
    let Some(hold) = flight.phases().into_iter().find(|interval| interval.phase == Phase::Hold) else {
        return Vec::new();
    };
    let to = hold.to.seconds();
    values.iter().filter(|(t, _)| (to - 6.0..to).contains(t)).map(|(_, value)| *value).collect()
}

/// First peak, the trough after it and the peak after that, m; each turn is one of 1 cm at least.
pub fn rebound(z: &[f64]) -> Option<[f64; 3]> {
    const TURN_M: f64 = 0.01;
    let mut turns = Vec::new();
    let (mut extreme, mut rising) = (0.0_f64, true);
    for z in z {
        let beyond = if rising { *z > extreme } else { *z < extreme };
        if beyond {
            extreme = *z;
        } else if (z - extreme).abs() > TURN_M {
            turns.push(extreme);
            (extreme, rising) = (*z, !rising);
        }
    }
    turns.push(extreme);
    let [peak, trough, again, ..] = turns.as_slice() else { return None };
    Some([*peak, *trough, *again])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rebound_is_a_peak_a_trough_and_a_peak_whatever_the_noise() {
        let hop = [0.0, 0.005, 0.1, 0.2, 0.195, 0.1, 0.02, 0.025, 0.02, 0.05, 0.09, 0.08];
        assert_eq!(rebound(&hop), Some([0.2, 0.02, 0.09]));
        assert_eq!(rebound(&[0.0, 0.1, 0.2, 0.1, 0.0, 0.0]), None);
    }
}

//! What the paper says, and what the bench made of it.

use bench_identification::Law;
use bench_rig::Phase;
use bench_statistics::median_high;
use serde::Serialize;

use super::{
    DISCHARGE, Work,
    series::{rebound, seen, seen_speed, settled, true_altitude, true_speed},
};
use crate::words::{self, short, with_sigma};

/// A climb that a room calls violent: this fast after a second, m/s.
const VIOLENT_M_S: f64 = 0.5;
/// The altitude of figure 15, m.
const CAPTURE_M: f64 = 0.4;

/// One statement of the paper and what the bench made of it.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Statement {
    pub(super) figure: &'static str,
    pub(super) section: &'static str,
    pub(super) stated: &'static str,
    pub(super) made: String,
    pub(super) rule: &'static str,
    pub(super) passed: bool,
}

impl Work {
    /// All of them, in the order of the figures.
    pub(super) fn statements(&self) -> Vec<Statement> {
        let mut out = Vec::new();
        self.interface(&mut out);
        self.balance(&mut out);
        self.hop(&mut out);
        self.climb(&mut out);
        out
    }

    /// Figure 4 and section 2.
    fn interface(&self, out: &mut Vec<Statement>) {
        let ticks: Vec<f64> =
            self.climb.ticks.windows(2).map(|pair| pair[1].started.since_s(pair[0].started)).collect();
        let period = median_high(ticks).unwrap_or(f64::NAN);
        let waits: Vec<f64> =
            self.climb.positions.iter().map(|p| p.arrived_at.since_s(p.exposed_at)).collect();
        let latency = median_high(waits).unwrap_or(f64::NAN);
        out.push(Statement {
            figure: "4",
            section: "2",
            stated: "an iteration takes 0.1 s, data are 0.3 s late",
            made: format!("{} s, {} s (medians of the recording)", short(period), short(latency)),
            rule: "within 1 %",
            passed: (period - 0.1).abs() < 0.001 && (latency - 0.3).abs() < 0.003,
        });
        let mut seen: Vec<f64> = self.climb.positions.iter().map(|p| p.position_m[2]).collect();
        seen.sort_by(f64::total_cmp);
        let step =
            seen.windows(2).map(|pair| pair[1] - pair[0]).filter(|d| *d > 1e-6).fold(f64::INFINITY, f64::min);
        out.push(Statement {
            figure: "4",
            section: "2",
            stated: "positions resolve 5 mm",
            made: format!("least step between positions seen: {:.1} mm", 1000.0 * step),
            rule: "within 1 %",
            passed: (step - 0.005).abs() < 5e-5,
        });
    }

    /// Figures 9 and 10, and the 5 % of section 3.9.
    fn balance(&self, out: &mut Vec<Statement>) {
        let line = &self.thrust.linearity;
        out.push(Statement {
            figure: "9",
            section: "3.4",
            stated: "thrust is linear in throttle over the range of flight",
            made: format!(
                "curvature {} (p {}), {:.2} % of the weight off the line at most",
                with_sigma(line.curvature),
                words::probability(line.curvature_p),
                100.0 * line.departure_of_weight
            ),
            rule: "p above 0.01, or below 1 % of the weight",
            passed: line.linear,
        });
        let differ = self.thrust.levels_differ.map_or(0.0, |differ| differ.of_weight);
        out.push(Statement {
            figure: "9",
            section: "3.4",
            stated: "from full to half charge thrust changes little",
            made: format!("{:.1} % of the weight at hover (battery: {DISCHARGE})", 100.0 * differ),
            rule: "below 5 %; above 0, or there was but one battery",
            passed: differ > 0.0 && differ < 0.05,
        });
        let a = &self.rig.airframe;
        // v' = excess/m - Cf v/m, out of the ground effect.
        let (mass, drag) = (a.mass_kg.value, a.drag_n_s_per_m.value);
        let rate = drag / mass;
        let per_acceleration = if rate > 0.0 { (1.0 - (-rate).exp()) / rate } else { 1.0 };
        let hover = a.throttle_for(a.weight_n());
        let excess = |speed: f64| {
            (a.throttle_for(a.weight_n() + mass * speed / per_acceleration) - hover) / (hover - a.sticks.min)
        };
        let launch = self.launch_excess(hover);
        out.push(Statement {
            figure: "9",
            section: "3.9",
            stated: "a violent climb takes about 5 % more throttle than hover",
            made: format!(
                "{:.1} % climbs at {VIOLENT_M_S} m/s after 1 s; the launch of figure 15 has {:.1} %",
                100.0 * excess(VIOLENT_M_S),
                100.0 * launch
            ),
            rule: "both from 3 to 7 %",
            passed: [excess(VIOLENT_M_S), launch].iter().all(|x| (0.03..=0.07).contains(x)),
        });
        let [multiplier, height] = &self.ground.numbers;
        out.push(Statement {
            figure: "10",
            section: "3.4",
            stated: "30 % more thrust at the ground",
            made: format!("{:.1} ± {:.1} %", 100.0 * (multiplier.after.0 - 1.0), 100.0 * multiplier.after.1),
            rule: "27 to 33 %",
            passed: (multiplier.after.0 - 1.3).abs() < 0.03,
        });
        out.push(Statement {
            figure: "10",
            section: "3.4",
            stated: "the ground effect ends at about 5 cm",
            made: format!("{:.2} ± {:.2} cm", 100.0 * height.after.0, 100.0 * height.after.1),
            rule: "4.5 to 5.5 cm",
            passed: (height.after.0 - 0.05).abs() < 0.005,
        });
        let best = &self.ground.laws[0];
        let odds = self.ground.laws.iter().filter(|law| law.law != Law::Linear).map(|law| law.nats);
        out.push(Statement {
            figure: "10",
            section: "3.4",
            stated: "a linear fall with altitude is adequate",
            made: format!(
                "best by evidence: {}; the next law is {:.1} nats behind the linear one",
                best.law.name(),
                -odds.fold(f64::MIN, f64::max)
            ),
            rule: "no law is better by 3 nats",
            passed: best.nats < 3.0,
        });
    }

    /// Greatest throttle of the launch over that which hovers, from rest.
    fn launch_excess(&self, hover: f64) -> f64 {
        let launch = self.climb.phases().into_iter().find(|interval| interval.phase == Phase::Launch);
        let min = self.rig.airframe.sticks.min;
        let most = self
            .climb
            .commands
            .iter()
            .filter(|command| launch.is_some_and(|l| command.time >= l.from && command.time < l.to))
            .map(|command| command.sticks.throttle)
            .fold(f64::MIN, f64::max);
        (most - hover) / (hover - min)
    }

    /// Figure 11.
    fn hop(&self, out: &mut Vec<Statement>) {
        let a = &self.rig.airframe;
        let open = self.hop.phases().into_iter().find(|interval| interval.phase == Phase::Open);
        let throttle = open
            .and_then(|open| self.hop.commands.iter().find(|command| command.time >= open.from))
            .map_or(f64::NAN, |command| command.sticks.throttle);
        let beyond = a.thrust_n(throttle) / a.weight_n();
        let ground = beyond * a.ground_effect(0.0);
        out.push(Statement {
            figure: "11",
            section: "3.5",
            stated: "one throttle lifts inside the ground effect and not beyond it",
            made: format!("thrust over weight {ground:.3} at the ground, {beyond:.3} beyond"),
            rule: "above 1, below 1",
            passed: ground > 1.0 && beyond < 1.0,
        });
        let [first, refined] = &self.hop_verified;
        let (first_verified, verified) = (&first.flights[0], &refined.flights[0]);
        let told = &verified.trajectory;
        let height = a.ground_effect.height_m.value;
        for (what, z) in [
            ("it flies a parabola back and rebounds before it touches: in flight", &told.seen_m),
            ("it flies a parabola back and rebounds before it touches: by the model", &told.nominal_m),
        ] {
            let turns = rebound(z);
            out.push(Statement {
                figure: "11",
                section: "3.5",
                stated: what,
                made: turns.map_or_else(
                    || "no rebound".to_owned(),
                    |[peak, trough, again]| {
                        format!(
                            "up to {:.1} cm, down to {:.1} cm, up to {:.1} cm",
                            100.0 * peak,
                            100.0 * trough,
                            100.0 * again
                        )
                    },
                ),
                rule: "above the ground effect, then within it and off the ground, then up by 1 cm",
                passed: turns.is_some_and(|[peak, trough, again]| {
                    peak > height && trough > 0.0 && trough < height && again > trough + 0.01
                }),
            });
        }
        out.push(Statement {
            figure: "11",
            section: "3.5",
            stated: "model and flight agree very closely, after minor changes to what the rig told",
            made: format!(
                "{:.1} cm RMS 1 s ahead; {:.1} cm from the throttle alone ({:.1} cm before the changes), {:.0} % of sightings in the band of 95 %",
                100.0 * verified.k_step_m[1].unwrap_or(f64::NAN),
                100.0 * verified.trajectory_rms_m,
                100.0 * first_verified.trajectory_rms_m,
                100.0 * verified.inside
            ),
            rule: "`bench verify` passes with its usual tolerance and 5 cm from the throttle alone",
            passed: refined.passed && verified.trajectory_rms_m < 0.05,
        });
    }

    /// Figures 15 and 16.
    fn climb(&self, out: &mut Vec<Statement>) {
        for (what, flight, speeds) in [
            ("rapid at first, then momentum is lost: in flight", &self.climb, seen_speed(&self.climb)),
            (
                "rapid at first, then momentum is lost: by the model",
                &self.model_climb,
                true_speed(&self.model_climb),
            ),
        ] {
            let Some(hold) = flight.phases().into_iter().find(|interval| interval.phase == Phase::Hold)
            else {
                continue;
            };
            let hold_s = hold.from.seconds();
            let most = |from: f64, to: f64| {
                speeds
                    .iter()
                    .filter(|(t, _)| (from..to).contains(t))
                    .map(|(_, v)| *v)
                    .fold(f64::MIN, f64::max)
            };
            let (launch, after) = (most(0.0, hold_s + 0.3), most(hold_s + 1.0, hold_s + 5.0));
            out.push(Statement {
                figure: "15, 16",
                section: "3.8",
                stated: what,
                made: format!("{launch:.2} m/s in the launch, at most {after:.2} m/s from 1 to 5 s after it"),
                rule: "above 0.3 m/s, then less than half of it",
                passed: launch > 0.3 && after < 0.5 * launch,
            });
        }
        for (what, z) in [
            ("the loop captures and holds 0.4 m: in flight", seen(&self.climb)),
            ("the loop captures and holds 0.4 m: by the model", true_altitude(&self.model_climb)),
        ] {
            let settled = settled(&self.climb, &z);
            let n = settled.len().max(1) as f64;
            let mean = settled.iter().sum::<f64>() / n;
            let rms = (settled.iter().map(|z| (z - CAPTURE_M).powi(2)).sum::<f64>() / n).sqrt();
            out.push(Statement {
                figure: "15",
                section: "3.8",
                stated: what,
                made: format!("{:.3} m on average over the last 6 s, {:.1} cm RMS off", mean, 100.0 * rms),
                rule: "within 2 cm, 2 cm RMS",
                passed: !settled.is_empty() && (mean - CAPTURE_M).abs() < 0.02 && rms < 0.02,
            });
        }
        let unsteady = |speeds: Vec<(f64, f64)>| {
            let v = settled(&self.climb, &speeds);
            let n = v.len().max(1) as f64;
            let mean = v.iter().sum::<f64>() / n;
            (v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
        };
        let (flight, model) = (unsteady(seen_speed(&self.climb)), unsteady(true_speed(&self.model_climb)));
        out.push(Statement {
            figure: "16",
            section: "3.8",
            stated: "the flight's speed is less steady than the simulation's",
            made: format!("{flight:.3} m/s RMS in the hold, {model:.3} m/s by the model"),
            rule: "more than the model's",
            passed: flight > model,
        });
    }
}

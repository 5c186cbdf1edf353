//! Where the gap lies, by stage: one modelled signal after another is replaced by what was recorded or fitted, and the
//! gain of likelihood is shared out over the stages.
//!
//! A stage's share is its mean gain over all orders in which stages may be replaced (Shapley, A Value for n-Person Games,
//! 1953), so that shares add up whatever explains the same.

use bench_filter::{Input, Point, Track, held, nll};
use bench_inference::{Fit, Problem};
use bench_plant::effects::LIBRARY;
use rayon::prelude::*;
use serde::Serialize;

use crate::gap::Figure;

/// A stage's share of the gap between the rig as it is and the best hypothesis.
#[derive(Clone, Debug, Serialize)]
pub struct StageShare {
    /// `loop`, `output`, `frames`, `numbers`, or the stage of the effect.
    pub stage: &'static str,
    /// What replaced what.
    pub replaced: &'static str,
    /// Gain of log-likelihood, nats, with an interval of 90 % over flights.
    pub gain_nats: Figure,
    /// The gain as a share of all stages' gains, where they gain anything.
    pub share: Option<f64>,
}

#[derive(Clone, Copy, PartialEq)]
enum Player {
    Loop,
    Output,
    Frames,
    Rotor,
    Numbers,
    Effect,
}

/// Shares of all stages that can be replaced in these flights.
pub fn stages(problem: &Problem<'_>, null: &Fit, best: &Fit) -> Vec<StageShare> {
    let differ = |change: fn(&mut Track)| {
        problem.tracks.iter().any(|track| {
            let mut changed = track.clone();
            change(&mut changed);
            changed != *track
        })
    };
    let mut players = Vec::new();
    if differ(as_scheduled) {
        players.push(Player::Loop);
    }
    if differ(Track::as_commanded) {
        players.push(Player::Output);
    }
    if differ(as_believed) {
        players.push(Player::Frames);
    }
    if problem.tracks.iter().all(|track| with_rotor(track, problem).is_some()) {
        players.push(Player::Rotor);
    }
    players.push(Player::Numbers);
    if !best.point.effects.is_empty() {
        players.push(Player::Effect);
    }
    // One value a coalition, flight by flight.
    let values: Vec<Vec<f64>> =
        (0..1_usize << players.len()).map(|set| value(problem, null, best, &players, set)).collect();
    let all: Vec<usize> = (0..problem.tracks.len()).collect();
    let gains: Vec<Figure> = (0..players.len())
        .map(|player| {
            let on = |flights: &[&usize]| shapley(&values, players.len(), player, flights);
            // The same draws for each, of the same seed.
            Figure::over_flights(2, &all, on)
        })
        .collect();
    let total: f64 = gains.iter().map(|gain| gain.value.max(0.0)).sum();
    let mut shares: Vec<StageShare> = players
        .iter()
        .zip(gains)
        .map(|(player, gain_nats)| {
            let (stage, replaced) = match player {
                Player::Loop => ("loop", "scheduled by recorded times of the commands"),
                Player::Output => ("output", "commanded by read-back outputs"),
                Player::Frames => ("frames", "believed exposures by the frames' own clock"),
                Player::Rotor => ("rotor", "throttle by the square of the rotors' speed"),
                Player::Numbers => ("numbers", "the rig's numbers by fitted ones"),
                Player::Effect => (
                    LIBRARY[best.point.effects[0].0].stage.name(),
                    "the nominal law by the law with the effect",
                ),
            };
            let share = (total > 1.0).then(|| gain_nats.value.max(0.0) / total);
            StageShare { stage, replaced, gain_nats, share }
        })
        .collect();
    shares.sort_by(|a, b| b.gain_nats.value.total_cmp(&a.gain_nats.value));
    shares
}

/// Log-likelihood of each flight with a set of stages replaced, all at the best hypothesis' noise.
fn value(problem: &Problem<'_>, null: &Fit, best: &Fit, players: &[Player], set: usize) -> Vec<f64> {
    let has = |player: Player| players.iter().enumerate().any(|(i, p)| *p == player && set >> i & 1 == 1);
    let point = match (has(Player::Numbers), has(Player::Effect)) {
        (false, false) => problem.nominal.clone(),
        (true, false) => null.point.clone(),
        (false, true) => Point { nuisances: problem.nominal.nuisances, ..best.point.clone() },
        (true, true) => best.point.clone(),
    };
    let noise =
        if has(Player::Effect) || best.random.is_empty() { best.full_noise(problem) } else { best.noise };
    problem
        .tracks
        .par_iter()
        .map(|track| {
            let mut track = track.clone();
            if players.contains(&Player::Loop) && !has(Player::Loop) {
                as_scheduled(&mut track);
            }
            if players.contains(&Player::Output) && !has(Player::Output) {
                track.as_commanded();
            }
            if players.contains(&Player::Frames) && !has(Player::Frames) {
                as_believed(&mut track);
            }
            if let Some(measured) = has(Player::Rotor).then(|| with_rotor(&track, problem)).flatten() {
                track = measured;
            }
            -nll(&track, problem.rig, &point, &noise)
        })
        .collect()
}

/// Lateness below which a schedule is as good as the record, s.
const ON_TIME_S: f64 = 0.003;

fn as_scheduled(track: &mut Track) {
    let late: Vec<f64> = track.late_s.clone();
    for (input, late_s) in track.inputs.iter_mut().zip(late) {
        if late_s > ON_TIME_S {
            input.time_s -= late_s;
        }
    }
}

fn as_believed(track: &mut Track) {
    for measurement in &mut track.measurements {
        measurement.exposed_s = measurement.believed_s;
    }
}

/// A track whose throttle is that which would hold the rotors at their measured speed: thrust goes with its square, by
/// a factor that this flight's own mean tells. `None` without rotors that turned.
fn with_rotor(track: &Track, problem: &Problem<'_>) -> Option<Track> {
    let offset = problem.rig.airframe.thrust.offset.value;
    let at: Vec<(f64, f64, f64)> = track
        .inputs
        .iter()
        .filter(|input| input.throttle > offset)
        .filter_map(|input| Some((input.time_s, input.throttle - offset, held(&track.rotor, input.time_s)?)))
        .collect();
    let square: f64 = at.iter().map(|(_, _, square)| square).sum();
    if square <= 0.0 || at.is_empty() {
        return None;
    }
    let per_square = at.iter().map(|(_, throttle, _)| throttle).sum::<f64>() / square;
    let (first_s, last_s) = (at[0].0, at[at.len() - 1].0);
    let mut measured = track.clone();
    let outside = track.inputs.iter().filter(|input| input.time_s < first_s || input.time_s > last_s);
    let inside = track.rotor.iter().filter(|(time_s, _)| (first_s..=last_s).contains(time_s));
    measured.inputs = outside.copied().collect();
    measured.inputs.extend(
        inside.map(|(time_s, square)| Input { time_s: *time_s, throttle: offset + per_square * square }),
    );
    measured.inputs.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    Some(measured)
}

fn shapley(values: &[Vec<f64>], players: usize, player: usize, flights: &[&usize]) -> f64 {
    let sum = |set: usize| flights.iter().map(|i| values[set][**i]).sum::<f64>();
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    (0..1_usize << players)
        .filter(|set| set >> player & 1 == 0)
        .map(|set| {
            let size = set.count_ones() as usize;
            let weight = factorial(size) * factorial(players - size - 1) / factorial(players);
            weight * (sum(set | 1 << player) - sum(set))
        })
        .sum()
}

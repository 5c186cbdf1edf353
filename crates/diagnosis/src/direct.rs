//! What can be read without a model of flight: readbacks against commands, the loop's lateness, frames that are late or
//! lost.
//!
//! Each channel has its own likelihood, in which effects of its stage compete with ordinary behaviour. A channel's
//! evidence adds to the evidence of the filter, which is fed with what the pins held and when.

use bench_filter::{TOGETHER_S, Track, known};
use bench_plant::effects::{Reading, read_as};
use bench_rig::Rig;
use bench_statistics::median_high;
use serde::Serialize;

use crate::{cycle::cycle, readback};

/// What the direct channels say.
#[derive(Clone, Debug, Default)]
pub struct Direct {
    /// Effects with a gain of log-likelihood over ordinary behaviour.
    pub effects: Vec<DirectEffect>,
    /// The lag of pins that were read on their way at a time that nobody knows: what they held is what it makes of the commands.
    pub lag_of_pins: Option<usize>,
    /// Two effects that explain a readback together, each half of what they gain.
    pub together: Option<[usize; 2]>,
    /// Log-likelihood that the pins' own stage leaves on the table: no law of the library explains the readback.
    pub unexplained_pins: f64,
    /// What was seen, for people.
    pub findings: Vec<Finding>,
}

impl Direct {
    /// Whether the readback says that pins do not hold what they were told.
    pub fn doubts_pins(&self) -> bool {
        self.unexplained_pins > 0.0 || self.effects.iter().any(|found| found.channel == "readback")
    }
}

/// An effect that a direct channel speaks for.
#[derive(Clone, Debug)]
pub struct DirectEffect {
    /// Library index.
    pub effect: usize,
    /// Where it was read. Effects of one channel explain the same.
    pub channel: &'static str,
    /// Gain of log-evidence over ordinary behaviour, nats.
    pub gain: f64,
    /// Its parameters in the order of the library.
    pub values: Vec<f64>,
    /// One sigma of each, as a fraction of the value.
    pub relative_sigma: f64,
}

/// A sentence of evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Channel: `readback`, `round trip`, `answers`, `ticks`, `frames` or `arrivals`.
    pub channel: &'static str,
    /// What was found.
    pub text: String,
}

/// Reads the direct channels of all flights.
pub fn direct(tracks: &[Track], rig: &Rig) -> Direct {
    let mut out = Direct::default();
    readback::pins(tracks, rig, &mut out);
    answers(tracks, rig, &mut out);
    ticks(tracks, &mut out);
    frames(tracks, rig, &mut out);
    arrivals(tracks, rig, &mut out);
    // What the rig says is there is no finding.
    let known = known(rig);
    out.effects.retain(|found| known.iter().all(|(effect, _)| *effect != found.effect));
    out
}

/// Nats that a law with a free number must gain.
pub(crate) const LAW_COST: f64 = 8.0;
/// A channel's likelihood is not exact: so many nats are as good as certain.
pub(crate) const MOST_DIRECT: f64 = 60.0;

/// A command's way to a real output that any serial port has, s.
const ORDINARY_WAY_S: f64 = 0.006;

/// How late a real output follows, and what it does not answer.
fn answers(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let Some(typical_s) = median_high(tracks.iter().flat_map(|t| &t.pins).map(|pin| pin.delay_s).collect())
    else {
        return;
    };
    let answered: usize = tracks.iter().map(|t| t.pins.len()).sum();
    if typical_s > ORDINARY_WAY_S {
        out.findings.push(Finding {
            channel: "round trip",
            text: format!("the output follows its commands {:.0} ms late in the median", 1e3 * typical_s), // unit
        });
        let ratio = typical_s / ORDINARY_WAY_S;
        let gain = answered as f64 * (0.5 * (ratio * ratio - 1.0) - ratio.ln()) - LAW_COST;
        if gain > 0.0 && out.effects.iter().all(|other| other.effect != read_as(Reading::PinLag)) {
            out.effects.push(DirectEffect {
                effect: read_as(Reading::PinLag),
                channel: "round trip",
                gain: gain.min(MOST_DIRECT),
                values: vec![typical_s],
                relative_sigma: 0.1,
            });
        }
    }
    let unanswered: usize = tracks.iter().map(|t| t.unanswered).sum();
    let (k, n) = (unanswered as f64, (answered + unanswered) as f64);
    let share = k / n;
    if k < 1.0 || share <= ORDINARY_LOSS {
        return;
    }
    let gain = k * (share / ORDINARY_LOSS).ln() - (n - k) * (share - ORDINARY_LOSS) - LAW_COST;
    if gain > 0.0 {
        out.findings.push(Finding {
            channel: "answers",
            text: format!(
                "{unanswered} of {n} commands were not answered: the pins may have kept what they held"
            ),
        });
        // A command that is lost comes with the next iteration's.
        out.effects.push(DirectEffect {
            effect: read_as(Reading::LateIterations),
            channel: "answers",
            gain: gain.min(MOST_DIRECT),
            values: vec![share, rig.control_loop.period_s],
            relative_sigma: k.sqrt().recip(),
        });
    }
}

/// Fewest iterations, frames or waits of which anything is told.
const LEAST_SAMPLES: usize = 50;
/// Lateness that any soft real-time loop has, s: below, nothing is told.
const ORDINARY_LATENESS_S: f64 = 0.001; // physics
/// Less than this in turn is the beat of two clocks, s.
const LATE_IN_TURN_S: f64 = 0.002;
/// So many scales of the ordinary beyond the median an iteration is late.
const LATE_SCALES: f64 = 8.0;

fn ticks(tracks: &[Track], out: &mut Direct) {
    let flights: Vec<&[f64]> = tracks.iter().map(|track| track.lateness_s.as_slice()).collect();
    let mut all = flights.concat();
    if all.len() < LEAST_SAMPLES {
        return;
    }
    all.sort_by(f64::total_cmp);
    let tail = late_tail(&all);
    let in_turn = cycle(&flights)
        .filter(|cycle| cycle.gain > LAW_COST && cycle.later_s > LATE_IN_TURN_S)
        .map(|cycle| {
            let text = format!(
                "in turn, one in {} of {} iterations started late, by {:.1} ms in the mean",
                cycle.length,
                all.len(),
                1e3 * cycle.later_s // unit
            );
            (cycle.gain - LAW_COST, vec![(cycle.length as f64).recip(), cycle.later_s], text)
        });
    let best = [tail, in_turn].into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((gain, values, text)) = best {
        let late = values[0] * all.len() as f64;
        out.findings.push(Finding { channel: "ticks", text });
        out.effects.push(DirectEffect {
            effect: read_as(Reading::LateIterations),
            channel: "ticks",
            gain: gain.min(MOST_DIRECT),
            values,
            relative_sigma: late.sqrt().recip(),
        });
    }
}

/// What of sorted lateness, s, lies beyond the ordinary: gain, the share of iterations and their mean lateness, and that in words.
fn late_tail(all: &[f64]) -> Option<(f64, Vec<f64>, String)> {
    let median = all[all.len() / 2];
    let upper = all[all.len() * 3 / 4] - median;
    // The scale of an exponential tail, from its quartile above the median (ln 2 of it), and not below the ordinary; then,
    // as clocks that count milliseconds blur quartiles, from the mean of all that is not late by that, where that is less.
    let late_by = |scale: f64| median + LATE_SCALES * scale;
    let coarse = (upper / std::f64::consts::LN_2).max(ORDINARY_LATENESS_S);
    let above = all.iter().filter(|x| (median..=late_by(coarse)).contains(*x)).map(|x| x - median);
    let scale = (above.clone().sum::<f64>() / above.count() as f64).clamp(ORDINARY_LATENESS_S, coarse);
    let threshold = late_by(scale);
    let late: Vec<f64> = all.iter().filter(|x| **x > threshold).map(|x| x - median).collect();
    let (n, k) = (all.len() as f64, late.len() as f64);
    let mean = late.iter().sum::<f64>() / k;
    let share = k / n;
    // Exponential waits of that mean at that rate, against the tail of the ordinary.
    let gain = late.iter().map(|x| (share / mean).ln() - x / mean + x / scale + scale.ln()).sum::<f64>()
        - (n - k) * share
        - LAW_COST;
    if gain <= 0.0 {
        return None;
    }
    let text = format!(
        "{} of {} iterations started late, by {:.0} ms in the mean and {:.0} ms at most",
        late.len(),
        all.len(),
        1e3 * mean,                                     // unit
        1e3 * late.iter().copied().fold(0.0, f64::max)  // unit
    );
    Some((gain, vec![share, mean], text))
}

/// Share of frames that any tracker may lose.
const ORDINARY_LOSS: f64 = 5e-4; // physics

fn frames(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let told: usize = tracks.iter().map(|t| t.frames_told).sum();
    let bursts: Vec<usize> = tracks.iter().flat_map(|t| t.bursts.iter().copied()).collect();
    let lost: usize = bursts.iter().sum();
    if told < LEAST_SAMPLES || lost == 0 {
        return;
    }
    let n = (told + lost) as f64;
    let ordinary = rig.tracker.dropout_probability.max(ORDINARY_LOSS);
    // Gilbert's chain against single losses at the ordinary rate.
    let k = bursts.len() as f64;
    let rate = k / n;
    let stay = ((lost as f64 - k) / lost as f64).clamp(0.02, 0.98); // numerical
    let gain = k * (rate / ordinary).ln() - (n - lost as f64) * (rate - ordinary)
        + (lost as f64 - k) * (stay / ordinary).ln()
        + k * (1.0 - stay).ln()
        - LAW_COST;
    if gain > 0.0 && rate > ordinary {
        let mean = lost as f64 / k;
        out.findings.push(Finding {
            channel: "frames",
            text: format!("{lost} of {} frames are missing, in {} bursts", told + lost, bursts.len()),
        });
        out.effects.push(DirectEffect {
            effect: read_as(Reading::LostFrames),
            channel: "frames",
            gain: gain.min(MOST_DIRECT),
            values: vec![lost as f64 / n, mean],
            relative_sigma: k.sqrt().recip(),
        });
    }
}

/// Spread of arrivals about a regular clock that any bus has, s.
const ORDINARY_JITTER_S: f64 = 0.0018; // physics

/// Share of frames that come with the one before, from which on they wait in a queue.
const QUEUED: f64 = 0.1;

fn arrivals(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let (mut n, mut fast, mut slow, mut wait) = (0.0, 0.0, 0.0, 0.0);
    let (mut together, mut own_s) = (0.0, 0.0);
    for track in tracks {
        if track.waits_s.len() < LEAST_SAMPLES {
            continue;
        }
        let waits = &track.waits_s;
        let mean = waits.iter().sum::<f64>() / waits.len() as f64;
        wait += waits.iter().sum::<f64>();
        n += waits.len() as f64;
        slow += waits.iter().map(|w| (w - mean).powi(2)).sum::<f64>();
        for w in waits.windows(2) {
            fast += 0.5 * (w[1] - w[0]).powi(2);
            // What the frame before leaves of its wait when the next is exposed, that one waits too; then its own, which
            // does not remember how long it has lasted.
            let rest = w[0] - rig.tracker.frame_period_s;
            if rest <= 0.0 {
                own_s += w[1];
            } else if w[1] - rest < TOGETHER_S {
                together += 1.0;
            } else {
                own_s += w[1] - rest - TOGETHER_S;
            }
        }
    }
    if n < 100.0 {
        return;
    }
    let (fast, slow) = ((fast / n).sqrt(), (slow / n).sqrt());
    let gain = |spread: f64| {
        let ratio = spread / ORDINARY_JITTER_S;
        if ratio > 1.0 { n * (0.5 * (ratio * ratio - 1.0) - ratio.ln()) - LAW_COST } else { 0.0 }
    };
    // Waits that do not remember one another: a queue. Waits that do: a latency that moves.
    let queued = together > QUEUED * n;
    if gain(fast) > 0.0 && (queued || fast > 0.6 * slow) {
        out.findings.push(Finding {
            channel: "arrivals",
            text: format!("frames arrive {:.1} ms (one sigma) off a regular clock", 1e3 * slow), // unit
        });
        out.effects.push(DirectEffect {
            effect: read_as(Reading::LateFrames),
            channel: "arrivals",
            gain: gain(fast).min(MOST_DIRECT),
            values: vec![if queued { own_s / (n - together) } else { fast }],
            relative_sigma: 0.05,
        });
    } else if gain(slow) > 0.0 {
        out.findings.push(Finding {
            channel: "arrivals",
            text: format!("the latency of frames wanders by {:.1} ms (one sigma)", 1e3 * slow), // unit
        });
        out.effects.push(DirectEffect {
            effect: read_as(Reading::Latency),
            channel: "arrivals",
            gain: gain(slow).min(MOST_DIRECT),
            values: vec![wait / n],
            relative_sigma: 0.2,
        });
    }
}

//! Which instant of B belongs to which instant of A.

use std::{fmt, str::FromStr};

use bench_rig::Phase;
use serde::{Deserialize, Serialize};

use super::{
    clock::{ClockFit, fit_clock},
    pair::Timing,
    report::{Alignment, Coverage, Segment},
    scan::{Leg, Scan, Signal},
};
use crate::Mode;

/// How the clocks of two recordings are brought together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Align {
    /// [`Align::None`] for two simulations that start together, else [`Align::Phase`], else [`Align::Clock`].
    #[default]
    Auto,
    /// Equal times belong together.
    None,
    /// The starts of the mission's phases belong together, from the first one after idle on.
    Phase,
    /// Offset and drift are estimated from a signal that both recordings hold.
    Clock,
}

impl Align {
    /// All ways.
    pub const ALL: [Self; 4] = [Self::Auto, Self::None, Self::Phase, Self::Clock];

    /// The name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::None => "none",
            Self::Phase => "phase",
            Self::Clock => "clock",
        }
    }
}

impl fmt::Display for Align {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Align {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|align| align.name() == name);
        found.ok_or_else(|| format!("no alignment is called {name:?}; there are auto, none, phase and clock"))
    }
}

/// Simulations that start within this of each other share their clock, ns: a tenth of the paper's loop period.
const SAME_START_NS: i64 = 10_000_000;
/// A clock is believed if the signals correlate at least so well once aligned by it.
const CORRELATION_MIN: f64 = 0.7;

/// A stretch of both recordings in which one shift (and drift) holds.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    leg: Option<&'static str>,
    /// First instant that is shared, ns.
    from_ns: [i64; 2],
    /// First instant that is not, ns.
    until_ns: [i64; 2],
    /// Seconds of A per second of B.
    rate: f64,
}

/// Puts instants of both recordings on A's clock.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TimeMap {
    pieces: Vec<Piece>,
}

impl TimeMap {
    fn identity() -> Self {
        Self { pieces: vec![Piece { leg: None, from_ns: [0; 2], until_ns: [i64::MAX; 2], rate: 1.0 }] }
    }

    fn clock(fit: &ClockFit) -> Self {
        let nanos = |seconds: f64| (seconds * 1e9).round() as i64;
        let from_ns = [nanos(fit.reference_s), nanos(fit.reference_s + fit.offset_s)];
        let rate = 1.0 / (1.0 + fit.drift);
        Self { pieces: vec![Piece { leg: None, from_ns, until_ns: [i64::MAX; 2], rate }] }
    }

    /// The instant on A's clock and the number of the piece that it lies in; `None` where the other recording has no
    /// such instant. `side` is 0 for instants of A and 1 for those of B.
    pub fn place(&self, side: usize, t_ns: i64) -> Option<(i64, u32)> {
        let after = self.pieces.partition_point(|piece| piece.from_ns[side] <= t_ns);
        // A single piece has no beginning: its `from_ns` is but the instant at which both clocks are known.
        let index = if self.pieces.len() == 1 { 0 } else { after.checked_sub(1)? };
        let piece = &self.pieces[index];
        let index = u32::try_from(index).unwrap_or(u32::MAX);
        if t_ns >= piece.until_ns[side] {
            return None;
        }
        Some((if side == 0 { t_ns } else { piece.on_a(t_ns) }, index))
    }

    /// Of each piece, where what is shared of it ends and where the next one begins, on A's clock, because one recording goes on
    /// where the other does not, ns; none for pieces that end together.
    pub fn cuts_ns(&self) -> Vec<Option<[i64; 2]>> {
        let cut = |(place, piece): (usize, &Piece)| {
            let next = self.pieces.get(place + 1)?;
            let goes_on = (0..2).any(|side| next.from_ns[side] > piece.until_ns[side]);
            goes_on.then_some([piece.until_ns[0], next.from_ns[0]])
        };
        self.pieces.iter().enumerate().map(cut).collect()
    }

    /// The instants of A that have a counterpart, and B's on A's clock, within the recordings' own ends. ns.
    fn shared_ns(&self, a_ns: (i64, i64), b_ns: (i64, i64)) -> i64 {
        let overlap = |piece: &Piece| {
            let from = a_ns.0.max(piece.from_ns[0]).max(piece.on_a(b_ns.0.max(piece.from_ns[1])));
            let until = a_ns.1.min(piece.until_ns[0]).min(piece.on_a(b_ns.1.min(piece.until_ns[1])));
            until.saturating_sub(from).max(0)
        };
        match self.pieces.as_slice() {
            [only] => {
                let from = a_ns.0.max(only.on_a(b_ns.0));
                let until = a_ns.1.min(only.on_a(b_ns.1));
                until.saturating_sub(from).max(0)
            }
            pieces => pieces.iter().map(overlap).sum(),
        }
    }

    /// From the first to the last instant of both recordings, on A's clock, ns.
    pub fn span_ns(&self, a: &Scan, b: &Scan) -> (i64, i64) {
        let b_ends = [b.first_ns, b.last_ns].map(|t_ns| self.place(1, t_ns).map(|(t_ns, _)| t_ns));
        (
            b_ends[0].map_or(a.first_ns, |t_ns| t_ns.min(a.first_ns)),
            b_ends[1].map_or(a.last_ns, |t_ns| t_ns.max(a.last_ns)),
        )
    }
}

impl Piece {
    fn on_a(&self, b_ns: i64) -> i64 {
        let since = b_ns.saturating_sub(self.from_ns[1]);
        if self.rate == 1.0 {
            self.from_ns[0].saturating_add(since)
        } else {
            self.from_ns[0].saturating_add((since as f64 * self.rate).round() as i64)
        }
    }
}

/// Brings two recordings together as wanted, or as well as they let it be done.
pub(super) fn align(wanted: Align, a: &Scan, b: &Scan, timing: Timing) -> (TimeMap, Alignment) {
    match wanted {
        Align::None => (TimeMap::identity(), unaligned(wanted, "as asked for".to_owned())),
        Align::Auto if timing == Timing::Lockstep && start_together(a, b) => {
            let reason = "both are simulations that start together".to_owned();
            (TimeMap::identity(), unaligned(wanted, reason))
        }
        Align::Auto | Align::Phase => match by_phase(a, b) {
            Ok(pieces) => phase_alignment(wanted, pieces, a, b),
            Err(no_phases) => by_clock(wanted, a, b, &format!("not by phase: {no_phases}")),
        },
        Align::Clock => by_clock(wanted, a, b, "as asked for"),
    }
}

fn start_together(a: &Scan, b: &Scan) -> bool {
    let departure = |scan: &Scan| scan.departure().map(|place| scan.phases[place].1);
    let close = |a_ns: i64, b_ns: i64| a_ns.abs_diff(b_ns) <= SAME_START_NS as u64;
    let modes = [a, b].map(|scan| scan.source.session().mode);
    modes == [Mode::Sim; 2]
        && close(a.first_ns, b.first_ns)
        && match (departure(a), departure(b)) {
            (Some(a_ns), Some(b_ns)) => close(a_ns, b_ns),
            (None, None) => true,
            _ => false,
        }
}

fn unaligned(wanted: Align, reason: String) -> Alignment {
    Alignment { wanted, used: Align::None, reason, ..Alignment::default() }
}

/// The pieces from the idle phase before the flight on, or why there are none.
fn by_phase(a: &Scan, b: &Scan) -> Result<Vec<Piece>, String> {
    let departure = |scan: &Scan, which: &str| {
        scan.departure().ok_or_else(|| {
            let why =
                if scan.phases.is_empty() { "has no /control/state" } else { "never leaves the idle phase" };
            format!("{which} {why}")
        })
    };
    let (a_first, b_first) = (departure(a, "A")?, departure(b, "B")?);
    let landings = a.settling_ns.len() == b.settling_ns.len();
    let (a_legs, b_legs) = (a.legs(landings), b.legs(landings));
    // The first phases belong together whatever they are called; later ones as long as their names agree.
    let (a_legs, b_legs) = (&a_legs[a_first..], &b_legs[b_first..]);
    let agreeing = a_legs.iter().zip(b_legs).skip(1).take_while(|(a, b)| a.is_like(**b)).count();
    let matched = 1 + agreeing;
    let idle_ns = (a_legs[0].from_ns - a.first_ns).min(b_legs[0].from_ns - b.first_ns);
    let mut pieces = vec![Piece {
        leg: Some(Phase::Idle.name()),
        from_ns: [a_legs[0].from_ns - idle_ns, b_legs[0].from_ns - idle_ns],
        until_ns: [a_legs[0].from_ns, b_legs[0].from_ns],
        rate: 1.0,
    }];
    for place in 0..matched {
        let until = |legs: &[Leg], last_ns: i64| {
            if place + 1 < matched { legs[place + 1].from_ns } else { last_ns.saturating_add(1) }
        };
        let from_ns = [a_legs[place].from_ns, b_legs[place].from_ns];
        let shared_ns = (until(a_legs, a.last_ns) - from_ns[0]).min(until(b_legs, b.last_ns) - from_ns[1]);
        pieces.push(Piece {
            leg: Some(a_legs[place].name()),
            from_ns,
            until_ns: from_ns.map(|from_ns| from_ns + shared_ns),
            rate: 1.0,
        });
    }
    Ok(pieces)
}

fn phase_alignment(wanted: Align, pieces: Vec<Piece>, a: &Scan, b: &Scan) -> (TimeMap, Alignment) {
    let seconds = |ns: i64| ns as f64 / 1e9;
    let end = |place: usize, side: usize, last_ns: i64| {
        pieces.get(place + 1).map_or(last_ns, |next| next.from_ns[side])
    };
    let segments = pieces.iter().enumerate().skip(1).map(|(place, piece)| Segment {
        phase: piece.leg.unwrap_or_default().to_owned(),
        a_from_s: seconds(piece.from_ns[0]),
        b_from_s: seconds(piece.from_ns[1]),
        a_duration_s: seconds(end(place, 0, a.last_ns) - piece.from_ns[0]),
        b_duration_s: seconds(end(place, 1, b.last_ns) - piece.from_ns[1]),
    });
    let segments: Vec<Segment> = segments.collect();
    let alignment = Alignment {
        wanted,
        used: Align::Phase,
        reason: if wanted == Align::Phase {
            "as asked for"
        } else {
            "both go through the phases of a mission"
        }
        .to_owned(),
        offset_s: segments[0].b_from_s - segments[0].a_from_s,
        segments,
        ..Alignment::default()
    };
    (TimeMap { pieces }, alignment)
}

fn by_clock(wanted: Align, a: &Scan, b: &Scan, reason: &str) -> (TimeMap, Alignment) {
    let fits = Signal::ALL.into_iter().filter_map(|signal| {
        let place = signal as usize;
        fit_clock(&a.signals[place], &b.signals[place]).map(|fit| (signal, fit))
    });
    let Some((signal, fit)) = fits.max_by(|(_, x), (_, y)| x.correlation.total_cmp(&y.correlation)) else {
        let why = "not by clock: no signal moves enough in both recordings";
        return (TimeMap::identity(), unaligned(wanted, format!("{reason}; {why}")));
    };
    if fit.correlation < CORRELATION_MIN {
        let why = format!(
            "not by clock: {} correlates to {:.2} at best, {CORRELATION_MIN} is needed",
            signal.path(),
            fit.correlation
        );
        return (TimeMap::identity(), unaligned(wanted, format!("{reason}; {why}")));
    }
    let start_s = a.first_ns as f64 / 1e9;
    let alignment = Alignment {
        wanted,
        used: Align::Clock,
        reason: reason.to_owned(),
        offset_s: fit.offset_s + fit.drift * (start_s - fit.reference_s),
        offset_std_s: Some(fit.offset_std_s),
        drift_ppm: Some(fit.drift * 1e6),
        drift_std_ppm: fit.drift_std.map(|std| std * 1e6),
        correlation: Some(fit.correlation),
        signal: Some(signal.path().to_owned()),
        segments: Vec::new(),
    };
    (TimeMap::clock(&fit), alignment)
}

/// How much of the flights the two recordings share.
pub(super) fn coverage(map: &TimeMap, a: &Scan, b: &Scan) -> Coverage {
    let (a_ns, b_ns) = (a.active_ns(), b.active_ns());
    let seconds = |(from, until): (i64, i64)| until.saturating_sub(from).max(0) as f64 * 1e-9;
    let longer_s = seconds(a_ns).max(seconds(b_ns));
    let shared_s = map.shared_ns(a_ns, b_ns) as f64 * 1e-9;
    Coverage {
        a_s: seconds(a_ns),
        b_s: seconds(b_ns),
        shared_s,
        share: if longer_s > 0.0 { (shared_s / longer_s).min(1.0) } else { 1.0 },
        enough: true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_phase_has_more_of_in_one_recording_has_no_counterpart() {
        let piece = |from_ns, until_ns| Piece { leg: None, from_ns, until_ns, rate: 1.0 };
        let map = TimeMap { pieces: vec![piece([0, 100], [50, 150]), piece([50, 170], [90, 210])] };
        assert_eq!(map.place(1, 120), Some((20, 0)));
        assert_eq!(map.place(1, 160), None);
        assert_eq!(map.place(1, 170), Some((50, 1)));
        assert_eq!(map.place(1, 99), None);
        assert_eq!(map.place(0, 95), None);
    }

    #[test]
    fn a_clock_is_undone_to_the_nanosecond_at_its_reference() {
        let fit = ClockFit {
            offset_s: 2.5,
            offset_std_s: 0.0,
            drift: 1e-4,
            drift_std: None,
            reference_s: 10.0,
            correlation: 1.0,
        };
        let map = TimeMap::clock(&fit);
        assert_eq!(map.place(1, 12_500_000_000), Some((10_000_000_000, 0)));
        // Ten seconds of A later, B's clock has gone 1 ms further.
        assert_eq!(map.place(1, 22_501_000_000), Some((20_000_000_000, 0)));
        assert_eq!(map.place(1, 2_499_000_000), Some((0, 0)));
    }
}

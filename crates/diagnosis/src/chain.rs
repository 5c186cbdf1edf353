//! Two laws of a pin, one behind the other: the second makes of what the first holds what the readback shows.

use bench_filter::{Pin, dragged};
use bench_statistics::evenly_in_log;
use rayon::prelude::*;

use crate::readback::PinChannel;

/// What a pin does with what it is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bend {
    /// Goes in steps of so much from rest.
    Steps(f64),
    /// Has so much play.
    Play(f64),
    /// Does not pass a level.
    Limit(f64),
}

impl Bend {
    fn size(&mut self) -> &mut f64 {
        match self {
            Self::Steps(size) | Self::Play(size) | Self::Limit(size) => size,
        }
    }
}

/// Two laws, the first one first, and what they leave.
pub struct Chain {
    pub bends: [Bend; 2],
    /// Half the squared residuals, capped, in sigmas.
    pub excess: f64,
}

/// On whole flights of so many readbacks sizes are looked for, and on so many they are refined.
const ROUGH_PINS: usize = 700; // numerical
const FINE_PINS: usize = 6_000; // numerical
/// So many of the best of each two laws are refined, each size in turn, over spans that shrink.
const REFINED: usize = 3; // numerical
const SPANS: [f64; 4] = [0.04, 0.015, 0.005, 0.0015]; // numerical
const SPAN_STEPS: i32 = 15; // numerical

/// The likeliest two laws of all that a chain may have, in either order.
pub fn chain(channel: &PinChannel<'_>) -> Option<Chain> {
    let sizes = sizes(channel);
    let orders = (0..sizes.len()).flat_map(|a| (0..sizes.len()).map(move |b| (a, b)));
    let (few, many) = (channel.some(ROUGH_PINS), channel.some(FINE_PINS));
    orders
        .filter(|(a, b)| a != b)
        .filter_map(|(a, b)| {
            let pairs: Vec<[Bend; 2]> =
                sizes[a].iter().flat_map(|a| sizes[b].iter().map(|b| [*a, *b])).collect();
            let mut rough: Vec<(f64, [Bend; 2])> =
                pairs.into_par_iter().map(|bends| (off(&few, bends), bends)).collect();
            rough.sort_by(|a, b| a.0.total_cmp(&b.0));
            rough.truncate(REFINED);
            let fine = rough.into_par_iter().map(|(_, bends)| refined(&many, bends));
            let (_, bends) = fine.min_by(|a, b| a.0.total_cmp(&b.0))?;
            Some(Chain { bends, excess: excess(channel, bends) })
        })
        .min_by(|a, b| a.excess.total_cmp(&b.excess))
}

/// Sizes to begin with, law by law.
fn sizes(channel: &PinChannel<'_>) -> [Vec<Bend>; 3] {
    let (min, max) = (channel.rig.airframe.sticks.min, channel.rig.airframe.sticks.max);
    let highest = channel.pins().map(|pin| pin.asked).fold(min, f64::max);
    [
        channel.coarse_steps().map(Bend::Steps).collect(),
        evenly_in_log(0.0015, 0.15, 40).map(|fraction| Bend::Play(fraction * (max - min))).collect(), // numerical
        (1..60).map(|i| Bend::Limit(highest - 0.01 * f64::from(i) * (highest - min))).collect(), // numerical
    ]
}

/// What a chain makes of what was asked for, readback by readback of a flight.
fn held(channel: &PinChannel<'_>, bends: [Bend; 2]) -> impl FnMut(&Pin, bool) -> f64 + use<> {
    let rest = channel.rig.airframe.sticks.min;
    let mut places = [0.0; 2];
    move |pin, first| {
        bends.iter().zip(&mut places).fold(pin.asked, |told, (bend, place)| {
            *place = match *bend {
                Bend::Steps(step) => rest + step * ((told - rest) / step).round(),
                Bend::Play(_) if first => told,
                Bend::Play(width) => dragged(*place, told, width),
                Bend::Limit(level) => told.min(level),
            };
            *place
        })
    }
}

fn excess(channel: &PinChannel<'_>, bends: [Bend; 2]) -> f64 {
    channel.all(held(channel, bends))
}

/// Sum of distances from the readbacks: unlike the excess, it tells near from far where nearly all are off.
fn off(channel: &PinChannel<'_>, bends: [Bend; 2]) -> f64 {
    let mut law = held(channel, bends);
    let one = |(i, pin): (usize, &Pin)| (pin.readback - law(pin, i == 0)).abs();
    channel.flights.iter().flat_map(|pins| pins.iter().enumerate()).map(one).sum()
}

fn refined(channel: &PinChannel<'_>, mut bends: [Bend; 2]) -> (f64, [Bend; 2]) {
    let mut best = excess(channel, bends);
    for span in SPANS {
        for i in 0..bends.len() {
            let about = bends;
            for k in -SPAN_STEPS..=SPAN_STEPS {
                let mut tried = about;
                *tried[i].size() *= 1.0 + span * f64::from(k) / f64::from(SPAN_STEPS);
                let left = excess(channel, tried);
                if left < best {
                    (best, bends) = (left, tried);
                }
            }
        }
    }
    (best, bends)
}

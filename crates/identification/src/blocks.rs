//! Nominal flights left out in blocks: the model of the others, and by how much its numbers differ from block to block.
//!
//! A model that is not quite right has other best numbers for other kinds of flight, and flights of one kind stand next to one another.
//! What a block has of its own is not seen by the spread between flights of the same kind, so it is measured by leaving the block out
//! (delete-a-group jackknife; Kott, *The delete-a-group jackknife*, J. Official Stat. 17, 2001; blocks: Roberts et al.,
//! *Cross-validation strategies for data with temporal, spatial, hierarchical, or phylogenetic structure*, Ecography 40, 2017).

use std::ops::Range;

use bench_filter::{PerNumber, Point, RigNumber, Track};
use bench_rig::Rig;
use statrs::statistics::Statistics as _;

use crate::flight::{FlightIdentification, identify_flights};

/// A model is made of three flights at least, so of so many one can be left out.
pub const LEAST_FLIGHTS: usize = 4;
/// Into so many blocks more flights are parted.
const BLOCKS: usize = 3;

/// Flights that were left out, and the model of the others.
#[derive(Clone, Debug)]
pub struct Block {
    /// Which flights.
    pub flights: Range<usize>,
    /// The model.
    pub rig: Rig,
}

/// Leaves flights out block by block, and widens the tolerances of the model and of its blocks to at least the standard errors beside the
/// model's laws, and to how the blocks differ.
pub fn hold_out(
    tracks: &[Track],
    prior: &Rig,
    beside_laws: &PerNumber<f64>,
    found: &mut FlightIdentification,
) {
    let flights = tracks.len();
    let blocks = match flights {
        ..LEAST_FLIGHTS => 0,
        LEAST_FLIGHTS => LEAST_FLIGHTS,
        _ => BLOCKS,
    };
    let begin = |block: usize| block * flights / blocks;
    for block in 0..blocks {
        let own = begin(block)..begin(block + 1);
        let others = [&tracks[..own.start], &tracks[own.end..]].concat();
        match identify_flights(&others, prior) {
            Ok(model) => found.blocks.push(Block { flights: own, rig: model.rig }),
            Err(error) => {
                let names: Vec<&str> = tracks[own].iter().map(|track| track.name.as_str()).collect();
                found.warnings.push(format!(
                    "the nominal flights without {} make no model, so those were not held against one: {error}",
                    names.join(", ")
                ));
            }
        }
    }
    let rigs: Vec<Rig> = found.blocks.iter().map(|block| block.rig.clone()).collect();
    for number in RigNumber::ALL {
        let between = between_blocks(&rigs, number);
        let sigma = between.max(beside_laws[number]);
        widen(&mut found.rig, number, sigma);
        found.blocks.iter_mut().for_each(|block| widen(&mut block.rig, number, sigma));
        let name = Point::names(&found.rig)[number];
        if let Some(told) = found.numbers.iter_mut().find(|told| told.name == name) {
            told.between_flights = told.between_flights.max(between);
            told.after.1 = Point::nominal(&found.rig).1[number];
        }
    }
}

/// One sigma of a number between blocks: without a block of `k`, the mean of all moves by a `k - 1`th of what the block is off it.
/// 0 of less than two.
fn between_blocks(without: &[Rig], number: RigNumber) -> f64 {
    if without.len() < 2 {
        return 0.0;
    }
    let values = without.iter().map(|rig| Point::nominal(rig).0.nuisances[number]);
    (without.len() - 1) as f64 * values.std_dev()
}

/// Widens the tolerance of a number that has one.
fn widen(rig: &mut Rig, number: RigNumber, sigma: f64) {
    let weight_n = rig.airframe.weight_n();
    let thrust = &mut rig.airframe.thrust;
    let tolerance = match number {
        RigNumber::Mass | RigNumber::Origin => return,
        RigNumber::ThrustGain => {
            let gain = &mut thrust.gain_n_per_unit;
            if let Some(hover_sigma) = &mut thrust.hover_sigma {
                *hover_sigma = hover_sigma.max(sigma);
                // The gain is what carries the weight at the throttle that hovers.
                gain.sigma = gain.value * hover_sigma.hypot(thrust.offset.sigma) / (weight_n / gain.value);
                return;
            }
            &mut gain.sigma
        }
        RigNumber::ThrustOffset => &mut thrust.offset.sigma,
        RigNumber::GroundEffectMultiplier => &mut rig.airframe.ground_effect.multiplier.sigma,
        RigNumber::GroundEffectHeight => &mut rig.airframe.ground_effect.height_m.sigma,
        RigNumber::Drag => &mut rig.airframe.drag_n_s_per_m.sigma,
        RigNumber::Latency => &mut rig.tracker.latency_s.sigma,
    };
    if *tolerance > 0.0 {
        *tolerance = tolerance.max(sigma);
    }
}

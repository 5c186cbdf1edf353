//! Models a little otherwise, each in one direction: how far their states lie aside, and what of it the innovations feel.

use bench_plant::effects::Axis;
use bench_rig::Rig;
use nalgebra::{DMatrix, DVector};

use crate::{
    covariance::State,
    direction::{Direction, Hat, Seen},
    law::{Law, Point, Reach},
    passenger::{Measured, Passenger, Propagated, Reset, Updated},
    pins::dragged,
};

/// Of which pairs of directions the information is asked for; it is zero for the others. All of `n` directions cost `n^2` at each
/// measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pairs {
    /// Each with each.
    All,
    /// The first `head` with all, the others in blocks of `block` within each block.
    Arrow {
        /// How many stand at the head.
        head: usize,
        /// How many are in a block, one or more.
        block: usize,
    },
}

impl Pairs {
    /// Those before direction `i`, itself included, whose pairs with it are asked for.
    #[inline]
    fn before(self, i: usize) -> [std::ops::Range<usize>; 2] {
        match self {
            Self::Arrow { head, block } if i >= head => [0..head, i - (i - head) % block..i + 1],
            _ => [0..i + 1, 0..0],
        }
    }
}

/// Gradient and information of a flight's log-likelihood along directions.
pub(crate) struct Sensitivities {
    models: Vec<PerturbedModel>,
    pairs: Pairs,
    /// Slope of the innovation at hand by each direction.
    row: Vec<f64>,
    gradient: Vec<f64>,
    /// Lower triangle of the information, row by row.
    lower: Vec<f64>,
}

impl Sensitivities {
    pub(crate) fn new(point: &Point, rig: &Rig, directions: &[Direction], pairs: Pairs) -> Self {
        let models = directions.iter().map(|direction| PerturbedModel::new(point, rig, direction)).collect();
        let n = directions.len();
        Self { models, pairs, row: vec![0.0; n], gradient: vec![0.0; n], lower: vec![0.0; n * (n + 1) / 2] }
    }

    /// Gradient and information, in the order of the directions.
    pub(crate) fn into_sums(self) -> (DVector<f64>, DMatrix<f64>) {
        let n = self.row.len();
        let mut information = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let value = self.lower[i * (i + 1) / 2 + j];
                information[(i, j)] = value;
                information[(j, i)] = value;
            }
        }
        (DVector::from_vec(self.gradient), information)
    }
}

impl Passenger for Sensitivities {
    fn propagated(&mut self, step: &Propagated<'_>) {
        for model in &mut self.models {
            model.source.move_on(step);
            if let Some(flown) = &step.flown {
                let push = model.source.push(flown.middle, flown.force, flown.axes);
                model.aside = flown.transition.apply(model.aside);
                model.aside[0] += flown.transition.z[2] * push;
                model.aside[1] += flown.transition.v[2] * push;
            }
        }
    }

    fn updated(&mut self, update: &Updated<'_>) {
        for (model, slope) in self.models.iter().zip(&mut self.row) {
            *slope = model.slope(update);
        }
        if update.counts {
            let scored = &update.scored;
            let mut first = 0;
            for (i, slope) in self.row.iter().enumerate() {
                let weighted = scored.weight * slope / scored.variance;
                self.gradient[i] += weighted * scored.residual;
                let lower = &mut self.lower[first..=first + i];
                for range in self.pairs.before(i) {
                    for (sum, other) in lower[range.clone()].iter_mut().zip(&self.row[range]) {
                        *sum += weighted * other;
                    }
                }
                first += i + 1;
            }
        }
        for (model, slope) in self.models.iter_mut().zip(&self.row) {
            for (aside, k) in model.aside.iter_mut().zip(update.gain) {
                *aside -= k * slope;
            }
        }
    }

    fn reset(&mut self, reset: &Reset<'_>) {
        for model in &mut self.models {
            model.reset(reset);
        }
    }
}

/// A model that differs in one direction.
struct PerturbedModel {
    source: Source,
    /// Its state less the filter's, per unit of the direction.
    aside: State,
}

/// What makes it differ.
enum Source {
    /// The law a little aside, the reciprocal of how far, and from where on it differs.
    Law(Box<Law>, f64, Reach),
    Hat(Hat),
    /// Frequency, rad/s, and phase.
    Wave(f64, f64),
    Steady,
    Play(Play),
    Seen(Seen),
}

/// A play of the thrust, over the weight.
struct Play {
    width: f64,
    /// Where its middle is.
    middle: f64,
}

impl Source {
    fn new(point: &Point, rig: &Rig, direction: &Direction) -> Self {
        match direction {
            Direction::Coordinate(at, step) => {
                let mut moved = point.clone();
                *moved.get_mut(*at) += step;
                Self::Law(Box::new(Law::new(&moved, rig)), step.recip(), Reach::of(*at, point, rig))
            }
            Direction::Added(effect, values) => {
                let mut moved = point.clone();
                moved.effects.push((*effect, values.clone()));
                Self::Law(Box::new(Law::new(&moved, rig)), 1.0, Reach::of_effect(*effect))
            }
            Direction::Hat(hat) => Self::Hat(*hat),
            Direction::Steady => Self::Steady,
            Direction::Play(width) => Self::Play(Play { width: *width, middle: 0.0 }),
            Direction::Seen(seen) => Self::Seen(*seen),
            Direction::Wave(hz, phase_rad) => Self::Wave(std::f64::consts::TAU * hz, *phase_rad),
        }
    }

    /// Moves what it remembers on over a step, beside the filter's law.
    #[inline]
    fn move_on(&mut self, step: &Propagated<'_>) {
        match self {
            Self::Law(law, _, reach) => {
                law.tilt_cos = step.law.tilt_cos;
                law.move_beside(step.law, *reach, step.h, step.holds, step.from);
            }
            Self::Play(play) => play.middle = dragged(play.middle, step.ratio, play.width),
            _ => {}
        }
    }

    /// Acceleration that it adds, per unit, at an altitude and speed where the law's is `force`.
    #[inline]
    fn push(&self, [z, v]: [f64; 2], force: f64, axes: &[f64; Axis::COUNT]) -> f64 {
        match self {
            Self::Law(_, _, Reach::Sight) | Self::Seen(_) => 0.0,
            Self::Law(law, inverse_step, _) => (law.acceleration_m_s2(z, v) - force) * inverse_step,
            Self::Steady => 1.0,
            Self::Hat(hat) => hat.at(axes[hat.axis as usize]),
            Self::Play(play) => 2.0 * (axes[Axis::ThrustToWeight as usize] - play.middle) / play.width,
            Self::Wave(rad_s, phase) => (rad_s * axes[Axis::Time as usize] + phase).sin(),
        }
    }
}

impl PerturbedModel {
    fn new(point: &Point, rig: &Rig, direction: &Direction) -> Self {
        Self { source: Source::new(point, rig, direction), aside: [0.0; 4] }
    }

    /// Slope of a measurement's prediction by the direction.
    #[inline]
    fn slope(&self, update: &Updated<'_>) -> f64 {
        let [z, v, ..] = *update.before.0;
        match &update.measured {
            Measured::Altitude { of, predicted_m, .. } => {
                let factor = of.factor;
                let shift = match &self.source {
                    Source::Law(law, inverse_step, _) => {
                        let later_s = law.view.latency_s - update.law.view.latency_s;
                        (law.view.seen_m(z) - predicted_m - later_s * v * factor) * inverse_step
                    }
                    Source::Hat(_) | Source::Wave(..) | Source::Steady | Source::Play(_) => 0.0,
                    Source::Seen(Seen::Altitude(hat)) => hat.at(z),
                    Source::Seen(Seen::Thrust) => update.axes[Axis::ThrustToWeight as usize] - 1.0,
                    Source::Seen(Seen::Time) => update.axes[Axis::Time as usize],
                    Source::Seen(Seen::Latency) => -v * factor * update.axes[Axis::Time as usize],
                };
                factor * self.aside[0] + shift
            }
            Measured::OnBoard { slopes: [az, av, ..], force: Some(force), .. } => {
                let push = self.source.push([z, v], *force, update.axes);
                let [dz, dv, db, dw] = self.aside;
                push + az * dz + av * dv + db + dw
            }
            Measured::OnBoard { force: None, .. } => self.aside[1],
        }
    }

    fn reset(&mut self, reset: &Reset<'_>) {
        match reset {
            Reset::LiftOff(_) => {}
            Reset::Standing => {
                self.aside[0] = 0.0;
                self.aside[1] = 0.0;
            }
            // What stops it, stops this one a little aside.
            Reset::Stopped { ceiling_m } => {
                self.aside[0] = match (&self.source, ceiling_m) {
                    (Source::Law(law, inverse_step, _), Some(own_m)) if law.ceiling_m.is_finite() => {
                        (law.ceiling_m - own_m) * inverse_step
                    }
                    _ => 0.0,
                };
                self.aside[1] = 0.0;
            }
            Reset::Carried { law: own, at: [z, v], .. } => {
                let altitude = match &self.source {
                    // Whatever is believed of tracker and latency, it was seen here.
                    Source::Law(law, inverse_step, _) => {
                        let later_s = law.view.latency_s - own.view.latency_s;
                        let seen = law.view.seen_m(*z) - own.view.seen_m(*z);
                        (later_s * v - seen / own.view.slope(*z)) * inverse_step
                    }
                    Source::Hat(_)
                    | Source::Wave(..)
                    | Source::Steady
                    | Source::Play(_)
                    | Source::Seen(_) => 0.0,
                };
                self.aside = [altitude, 0.0, self.aside[2], 0.0];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_that_are_asked_for_are_the_heads_and_those_of_a_block() {
        let asked = |pairs: Pairs, i: usize| pairs.before(i).into_iter().flatten().collect::<Vec<_>>();
        assert_eq!(asked(Pairs::All, 3), [0, 1, 2, 3]);
        let arrow = Pairs::Arrow { head: 2, block: 2 };
        assert_eq!(asked(arrow, 1), [0, 1]);
        assert_eq!(asked(arrow, 4), [0, 1, 4]);
        assert_eq!(asked(arrow, 5), [0, 1, 4, 5]);
    }
}

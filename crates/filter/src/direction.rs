//! Ways in which a model may be a little otherwise.

use bench_plant::effects::Axis;

use crate::law::Coordinate;

/// Something whose small change the innovations feel.
#[derive(Clone, Debug, PartialEq)]
pub enum Direction {
    /// A coordinate of the point, and the step by which its derivative is taken; the step's sign chooses the side.
    Coordinate(Coordinate, f64),
    /// An effect that the point lacks, by library index, at full size: a finite difference from the point.
    Added(usize, Vec<f64>),
    /// An acceleration of 1 m/s^2 that swings at a frequency, Hz, with a phase, rad, from take-off on.
    Wave(f64, f64),
    /// An acceleration of 1 m/s^2 all along.
    Steady,
    /// An acceleration of 1 m/s^2 upwards at one end of a play of the thrust, of such a width over the weight, downwards at the
    /// other, and in proportion between: at the upper end once the throttle has risen through it.
    Play(f64),
    /// A free offset of measurements.
    Seen(Seen),
    /// A free acceleration of 1 m/s^2 where a quantity is near a knot, falling linearly to its neighbours.
    Hat(Hat),
}

/// What a tracker may get wrong, per unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// 1 m near an altitude.
    Altitude(Hat),
    /// 1 m at a thrust of twice the weight, none at the weight.
    Thrust,
    /// 1 m a second of flight.
    Time,
    /// Latency that grows by 1 s a second of flight.
    Latency,
}

/// One hat function of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hat {
    /// Which quantity.
    pub axis: Axis,
    /// The knot before, the knot itself, the knot after. Equal neighbours: the first or last knot, whose hat goes on.
    pub knots: [f64; 3],
}

impl Hat {
    #[inline]
    pub(crate) fn at(&self, x: f64) -> f64 {
        let [before, at, after] = self.knots;
        if x < at {
            if before == at { 1.0 } else { ((x - before) / (at - before)).max(0.0) }
        } else if after == at {
            1.0
        } else {
            ((after - x) / (after - at)).max(0.0)
        }
    }
}

//! The coordinates that are fitted: numbers of the rig and parameters of effects, each in its own scale and with its prior.

use bench_filter::{Coordinate, Direction, Pass, Point};
use bench_plant::effects::{LIBRARY, Prior};
use nalgebra::{DMatrix, DVector};

/// A coordinate that is fitted, with its prior in its own scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Free {
    /// Which.
    pub at: Coordinate,
    /// Whether it is fitted as its natural logarithm.
    pub logarithmic: bool,
    /// Prior mean, in its own scale.
    pub mean: f64,
    /// Prior standard deviation, in its own scale.
    pub sigma: f64,
    /// Range of the value.
    pub(crate) range: (f64, f64),
}

impl Free {
    /// A value in the coordinate's own scale: its natural logarithm, where [`Free::logarithmic`] says so.
    pub fn own(&self, value: f64) -> f64 {
        if self.logarithmic { value.max(1e-12).ln() } else { value }
    }

    /// The value at a place of the coordinate's own scale, within the coordinate's range.
    pub fn value(&self, own: f64) -> f64 {
        let value = if self.logarithmic { own.exp() } else { own };
        value.clamp(self.range.0, self.range.1)
    }

    /// Step for the derivative, in units of the value.
    fn step(&self, value: f64) -> f64 {
        let step = if self.logarithmic { 0.03 * value } else { 0.03 * self.sigma }; // numerical
        if value + step > self.range.1 { -step } else { step }
    }

    /// Derivative of the value by the own scale.
    pub fn slope(&self, value: f64) -> f64 {
        if self.logarithmic { value } else { 1.0 }
    }
}

/// The parameter that is started where flights end.
pub(crate) const CEILING: &str = "ceiling_m";
/// Of the flights' top: no surface is far below where an airframe was seen.
pub(crate) const LOWEST_CEILING: f64 = 0.75;

/// Free coordinates with steps for their derivatives.
pub fn directions(free: &[Free], point: &Point) -> Vec<Direction> {
    free.iter().map(|f| Direction::Coordinate(f.at, f.step(point.get(f.at)))).collect()
}

/// The coordinates of one effect.
pub(crate) fn effect_coordinates(slot: usize, effect: usize) -> impl Iterator<Item = Free> {
    LIBRARY[effect].parameters.iter().enumerate().map(move |(parameter, p)| {
        let (logarithmic, mean, sigma) = match p.prior {
            Prior::Normal { mean, sigma } => (false, mean, sigma),
            Prior::LogNormal { median, sigma_ln } => (true, median.ln(), sigma_ln),
        };
        let limits = LIBRARY[effect].signature.fitted_up_to;
        let most = limits.iter().find(|(key, _)| *key == p.key).map_or(p.max, |(_, most)| *most);
        Free { at: Coordinate::Effect { slot, parameter }, logarithmic, mean, sigma, range: (p.min, most) }
    })
}

/// What the coordinates of a point, which a pass has first, leave of information and gradient of its other directions
/// (Schur complement); `None` where they are not determined.
pub fn project(free: &[Free], point: &Point, pass: &Pass) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let fitted = free.len();
    let rest = pass.gradient.len() - fitted;
    let (own, own_gradient) = with_prior(free, point, pass);
    let own = own.cholesky()?;
    let cross = pass.information.view((fitted, 0), (rest, fitted));
    Some((
        pass.information.view((fitted, fitted), (rest, rest)) - cross * own.solve(&cross.transpose()),
        pass.gradient.rows(fitted, rest) - cross * own.solve(&own_gradient),
    ))
}

/// Information and gradient over the values of the coordinates of a point, which a pass has first, with their priors.
pub(crate) fn with_prior(free: &[Free], point: &Point, pass: &Pass) -> (DMatrix<f64>, DVector<f64>) {
    let n = free.len();
    let mut information = pass.information.view((0, 0), (n, n)).into_owned();
    let mut gradient = pass.gradient.rows(0, n).into_owned();
    for (i, f) in free.iter().enumerate() {
        let value = point.get(f.at);
        let per_value = f.slope(value).recip();
        information[(i, i)] += (per_value / f.sigma).powi(2);
        gradient[i] -= (f.own(value) - f.mean) / (f.sigma * f.sigma) * per_value;
    }
    (information, gradient)
}

/// Every choice of one value from each list, the last list's changing first.
pub(crate) fn every_choice(lists: impl Iterator<Item = Vec<f64>>) -> Vec<Vec<f64>> {
    lists.fold(vec![Vec::new()], |heads, values| {
        let with = |head: &Vec<f64>, value: f64| [head.as_slice(), &[value]].concat();
        heads.iter().flat_map(|head| values.iter().map(move |value| with(head, *value))).collect()
    })
}

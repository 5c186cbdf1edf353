//! First-order responses, exact over a step of any length during which their input is held.

use super::{Parameter, Prior};

/// Mean of `e^-s` for `s` from 0 to `x`: one at zero, zero at infinity.
#[inline]
pub(super) fn mean_decay(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { -(-x).exp_m1() / x }
}

/// A first-order lag `x' = (target - x)/tau`. A time constant of zero is no lag, exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lag {
    time_constant_s: f64,
    state: f64,
}

/// What a lag still has to go, `x - target`, over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Transient {
    pub(super) mean: f64,
    pub(super) mean_square: f64,
}

impl Lag {
    pub(super) fn new(time_constant_s: f64, state: f64) -> Self {
        Self { time_constant_s, state }
    }

    /// Moves on by `dt_s` towards `target`.
    #[inline]
    pub(super) fn advance(&mut self, dt_s: f64, target: f64) -> Transient {
        let start = self.state - target;
        if start == 0.0 || self.time_constant_s == 0.0 {
            self.state = target;
            return Transient { mean: 0.0, mean_square: 0.0 };
        }
        let ratio = dt_s / self.time_constant_s;
        let lost = (-ratio).exp_m1();
        self.state = target + start * (1.0 + lost);
        Transient {
            mean: -start * lost / ratio,
            mean_square: -start * start * lost * (2.0 + lost) / (2.0 * ratio),
        }
    }
}

/// Two lags in series, `x1' = (target - x1)/tau1`, `x2' = (x1 - x2)/tau2`, seen at the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TwoLags {
    first: Lag,
    second_s: f64,
    state: f64,
}

/// How much of a time constant is the second lag's, where a law has one.
pub(super) const SECOND_SHARE: Parameter = Parameter {
    key: "second_share",
    unit: "1",
    meaning: "share of the time constant that is a second lag, behind the first",
    min: 0.0,
    max: 0.45,
    prior: Prior::Normal { mean: 0.0, sigma: 0.2 },
    neutral: None,
    default: Some(0.0),
};

impl TwoLags {
    /// Lags whose time constants add up to `time_constant_s`, `second_share` of it (less than a half) the second's.
    pub(super) fn new(time_constant_s: f64, second_share: f64, state: f64) -> Self {
        let second_s = second_share * time_constant_s;
        Self { first: Lag::new(time_constant_s - second_s, state), second_s, state }
    }

    /// Whether it will have to go down for `target`.
    #[inline]
    pub(super) fn is_above(&self, target: f64) -> bool {
        self.first.state > target
    }

    /// Moves on by `dt_s` towards `target`, at `pace` times the usual rates.
    #[inline]
    pub(super) fn advance(&mut self, dt_s: f64, target: f64, pace: f64) -> Transient {
        let starts = [self.first.state - target, self.state - target];
        if starts == [0.0; 2] {
            return Transient { mean: 0.0, mean_square: 0.0 };
        }
        let dt_s = dt_s * pace;
        let first = self.first.advance(dt_s, target);
        if self.second_s == 0.0 {
            self.state = self.first.state;
            return first;
        }
        // What the first still has to go comes through the second so much larger, for it is the slower one; the rest decays as
        // the second alone (partial fractions).
        let first_s = self.first.time_constant_s;
        let larger = first_s / (first_s - self.second_s);
        let through = larger * starts[0];
        let mut alone = Lag::new(self.second_s, target + starts[1] - through);
        let second = alone.advance(dt_s, target);
        self.state = larger * (self.first.state - target) + alone.state;
        let both = mean_decay(dt_s / first_s + dt_s / self.second_s);
        Transient {
            mean: larger * first.mean + second.mean,
            mean_square: larger * larger * first.mean_square
                + 2.0 * through * (starts[1] - through) * both
                + second.mean_square,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Lag, TwoLags};

    #[test]
    fn of_two_lags_one_long_step_equals_many_short_ones_and_without_a_second_it_is_one() {
        let mut long = TwoLags::new(0.1, 0.3, 1.0);
        let mut short = long;
        let whole = long.advance(0.1, 3.0, 0.7);
        let (mut mean, mut mean_square) = (0.0, 0.0);
        for _ in 0..1000 {
            let part = short.advance(1e-4, 3.0, 0.7);
            mean += part.mean / 1000.0;
            mean_square += part.mean_square / 1000.0;
        }
        for (a, b) in [(long.first.state, short.first.state), (long.state, short.state)] {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
        assert!((whole.mean - mean).abs() < 1e-9 && (whole.mean_square - mean_square).abs() < 1e-9);
        // Equal time constants would be 1 - (1 + t/tau) e^(-t/tau): these are nearly so.
        let mut even = TwoLags::new(0.2, 0.4999, 0.0);
        even.advance(0.1, 1.0, 1.0);
        assert!((even.state - (1.0 - 2.0 * (-1.0_f64).exp())).abs() < 1e-3);

        let (mut one, mut two) = (Lag::new(0.05, 1.0), TwoLags::new(0.05, 0.0, 1.0));
        for target in [3.0, 2.0, 2.0] {
            let (one, two) = (one.advance(0.02, target), two.advance(0.02, target, 1.0));
            assert!((one.mean - two.mean).abs() < 1e-12 && (one.mean_square - two.mean_square).abs() < 1e-12);
        }
    }

    #[test]
    fn one_long_step_equals_many_short_ones_in_state_mean_and_mean_square() {
        let mut long = Lag::new(0.05, 1.0);
        let mut short = long;
        let whole = long.advance(0.1, 3.0);
        let (mut mean, mut mean_square) = (0.0, 0.0);
        for _ in 0..1000 {
            let part = short.advance(1e-4, 3.0);
            mean += part.mean / 1000.0;
            mean_square += part.mean_square / 1000.0;
        }
        // From -2 over two time constants: -2 (1 - e^-2)/2 and 4 (1 - e^-4)/4.
        assert!((whole.mean - ((-2.0_f64).exp() - 1.0)).abs() < 1e-12);
        assert!((whole.mean_square - (1.0 - (-4.0_f64).exp())).abs() < 1e-12);
        assert!((long.state - (3.0 - 2.0 * (-2.0_f64).exp())).abs() < 1e-12);
        assert!((short.state - long.state).abs() < 1e-9);
        assert!((mean - whole.mean).abs() < 1e-9);
        assert!((mean_square - whole.mean_square).abs() < 1e-9);
    }

    #[test]
    fn without_a_time_constant_nothing_lags() {
        let mut none = Lag::new(0.0, 1.0);
        let step = none.advance(1e-3, 3.0);
        assert_eq!((step.mean, step.mean_square, none.state), (0.0, 0.0, 3.0));
    }
}

//! First-order responses, exact over a step of any length during which their input is held.

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
        let ratio = dt_s / self.time_constant_s;
        self.state = target + start * (-ratio).exp();
        Transient { mean: start * mean_decay(ratio), mean_square: start * start * mean_decay(2.0 * ratio) }
    }
}

#[cfg(test)]
mod tests {
    use super::Lag;

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

//! First-order responses, exact over a step of any length during which their input is held.

use nalgebra::Complex;

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
    /// The last step's length and what of a transient it lost, less one: steps of the same length follow each other.
    last: (f64, f64),
}

/// What a lag still has to go, `x - target`, over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Transient {
    pub(super) mean: f64,
    pub(super) mean_square: f64,
}

impl Lag {
    pub(super) fn new(time_constant_s: f64, state: f64) -> Self {
        Self { time_constant_s, state, last: (0.0, 0.0) }
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
        if dt_s != self.last.0 {
            self.last = (dt_s, (-ratio).exp_m1());
        }
        let (_, lost) = self.last;
        self.state = target + start * (1.0 + lost);
        Transient {
            mean: -start * lost / ratio,
            mean_square: -start * start * lost * (2.0 + lost) / (2.0 * ratio),
        }
    }
}

/// A lag of second order, `a tau^2 x'' + tau x' + x = target`: up to `a = 1/4` two in series, seen at the second, beyond a response
/// that overshoots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TwoLags {
    /// What the second lag follows, `x + second_s x'`.
    first: Lag,
    second_s: f64,
    state: f64,
    /// Where it overshoots: the rate at which the response turns and decays, 1/s.
    turning_per_s: Option<Complex<f64>>,
}

/// By how much a lag is of second order, where a law has that.
pub(super) const SECOND_ORDER: Parameter = Parameter {
    key: "second_order",
    unit: "1",
    meaning: "coefficient a of a tau^2 x'': 0 a first-order lag, up to 1/4 two lags in series, beyond it overshoots, with a damping ratio of 1/(2 sqrt(a))",
    min: 0.0,
    max: 1.5,
    prior: Prior::Normal { mean: 0.0, sigma: 0.6 },
    neutral: None,
    default: Some(0.0),
};

/// Two lags that are the same have no partial fractions: they are not quite.
const NEARLY_EVEN: f64 = 1e-4;

impl TwoLags {
    /// A lag of the time constant `tau`, of second order by `a`.
    pub(super) fn new(time_constant_s: f64, second_order: f64, state: f64) -> Self {
        let discriminant = 1.0 - 4.0 * second_order;
        let overshoots = discriminant < 0.0 && time_constant_s > 0.0;
        let root = discriminant.abs().max(NEARLY_EVEN).sqrt();
        let second_s = time_constant_s * if overshoots { 0.5 } else { 0.5 * (1.0 - root) };
        let turning_per_s =
            overshoots.then(|| Complex::new(-1.0, root) / (2.0 * second_order * time_constant_s));
        Self { first: Lag::new(time_constant_s - second_s, state), second_s, state, turning_per_s }
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
        if let Some(rate) = self.turning_per_s {
            return self.turn(dt_s, target, rate);
        }
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

    /// The same of a response that overshoots: what it still has to go is the real part of `c e^(rate t)`.
    fn turn(&mut self, dt_s: f64, target: f64, rate: Complex<f64>) -> Transient {
        let start = self.state - target;
        let slope = (self.first.state - self.state) / self.second_s;
        let c = Complex::new(start, (rate.re * start - slope) / rate.im);
        let mean = |x: Complex<f64>| if x.norm() < 1e-9 { Complex::from(1.0) } else { (x.exp() - 1.0) / x };
        let end = c * (rate * dt_s).exp();
        self.state = target + end.re;
        self.first.state = self.state + self.second_s * (rate * end).re;
        Transient {
            mean: (c * mean(rate * dt_s)).re,
            mean_square: 0.5 * c.norm_sqr() * mean_decay(-2.0 * rate.re * dt_s)
                + 0.5 * (c * c * mean(2.0 * rate * dt_s)).re,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Lag, TwoLags};

    #[test]
    fn of_two_lags_one_long_step_equals_many_short_ones_and_without_a_second_it_is_one() {
        let mut long = TwoLags::new(0.1, 0.21, 1.0);
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
        let mut even = TwoLags::new(0.2, 0.25, 0.0);
        even.advance(0.1, 1.0, 1.0);
        assert!((even.state - (1.0 - 2.0 * (-1.0_f64).exp())).abs() < 1e-3);

        let (mut one, mut two) = (Lag::new(0.05, 1.0), TwoLags::new(0.05, 0.0, 1.0));
        for target in [3.0, 2.0, 2.0] {
            let (one, two) = (one.advance(0.02, target), two.advance(0.02, target, 1.0));
            assert!((one.mean - two.mean).abs() < 1e-12 && (one.mean_square - two.mean_square).abs() < 1e-12);
        }
    }

    #[test]
    fn beyond_even_lags_the_response_overshoots_as_its_damping_ratio_says() {
        // A damping ratio of a half, a natural frequency of 1/tau.
        let mut long = TwoLags::new(0.05, 1.0, 0.0);
        let mut short = long;
        let whole = long.advance(0.25, 1.0, 1.0);
        let (mut mean, mut mean_square, mut highest) = (0.0, 0.0, 0.0_f64);
        for _ in 0..1000 {
            let part = short.advance(2.5e-4, 1.0, 1.0);
            mean += part.mean / 1000.0;
            mean_square += part.mean_square / 1000.0;
            highest = highest.max(short.state);
        }
        assert!(
            (long.state - short.state).abs() < 1e-9 && (long.first.state - short.first.state).abs() < 1e-9
        );
        assert!((whole.mean - mean).abs() < 1e-9 && (whole.mean_square - mean_square).abs() < 1e-9);
        // The step's overshoot, e^(-pi zeta/sqrt(1 - zeta^2)); steps of 0.25 ms miss its top by less than 1e-5.
        let overshoot = (-std::f64::consts::PI / 3.0_f64.sqrt()).exp();
        assert!((highest - 1.0 - overshoot).abs() < 1e-5, "{highest}");
        // It begins where two even lags end.
        let [mut below, mut above] = [0.249, 0.251].map(|a| TwoLags::new(0.05, a, 0.0));
        let [below, above] = [&mut below, &mut above].map(|lags| lags.advance(0.06, 1.0, 1.0));
        assert!((below.mean - above.mean).abs() < 1e-3, "{} {}", below.mean, above.mean);
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

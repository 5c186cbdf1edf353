//! The classical fourth-order Runge-Kutta step.

use crate::lanes::Real;

/// What a state does in time.
pub(crate) trait Motion<T, const N: usize> {
    /// The state's rate of change.
    fn derivative(&self, x: &[T; N]) -> [T; N];
}

impl<T, const N: usize, F: Fn(&[T; N]) -> [T; N]> Motion<T, N> for F {
    #[inline(always)]
    fn derivative(&self, x: &[T; N]) -> [T; N] {
        self(x)
    }
}

/// `x` after `dt_s` seconds of `dx/dt = derivative(x)`. The error of one step is of order `dt^5`, that of a flight of
/// order `dt^4` where `derivative` is smooth (Hairer, Norsett, Wanner, *Solving ODEs I*, table II.1.2).
#[inline(always)]
pub(crate) fn runge_kutta_4<T: Real, const N: usize>(
    x: &[T; N],
    dt_s: T,
    motion: &impl Motion<T, N>,
) -> [T; N] {
    let half_s = dt_s * 0.5;
    let k1 = motion.derivative(x);
    let k2 = motion.derivative(&along(x, &k1, half_s));
    let k3 = motion.derivative(&along(x, &k2, half_s));
    let k4 = motion.derivative(&along(x, &k3, dt_s));
    let mut mean = k1;
    for (((mean, k2), k3), k4) in mean.iter_mut().zip(k2).zip(k3).zip(k4) {
        *mean = *mean + (k2 + k3) * 2.0 + k4;
    }
    along(x, &mean, dt_s / dt_s.constant(6.0))
}

/// `x + slope dt_s`.
#[inline(always)]
fn along<T: Real, const N: usize>(x: &[T; N], slope: &[T; N], dt_s: T) -> [T; N] {
    let mut moved = *x;
    for (moved, slope) in moved.iter_mut().zip(slope) {
        *moved = *moved + *slope * dt_s;
    }
    moved
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error over one period of `z'' = -z` from (1, 0).
    fn error(steps: usize) -> f64 {
        let dt = std::f64::consts::TAU / steps as f64;
        let mut x = [1.0, 0.0];
        for _ in 0..steps {
            x = runge_kutta_4(&x, dt, &|x: &[f64; 2]| [x[1], -x[0]]);
        }
        (x[0] - 1.0).hypot(x[1])
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        // Order four: the observed order tends to 4 from within a tenth at these steps.
        for steps in [50, 100, 200] {
            let order = (error(steps) / error(2 * steps)).log2();
            assert!((order - 4.0).abs() < 0.1, "{steps} steps: order {order}");
        }
    }
}

//! The classical fourth-order Runge-Kutta step.

use nalgebra::SVector;

/// `x` after `dt_s` seconds of `dx/dt = derivative(x)`. The error of one step is of order `dt^5`, that of a flight of
/// order `dt^4` where `derivative` is smooth (Hairer, Norsett, Wanner, *Solving ODEs I*, table II.1.2).
#[inline]
pub fn runge_kutta_4<const N: usize>(
    x: &SVector<f64, N>,
    dt_s: f64,
    derivative: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
) -> SVector<f64, N> {
    let k1 = derivative(x);
    let k2 = derivative(&(x + k1 * (0.5 * dt_s)));
    let k3 = derivative(&(x + k2 * (0.5 * dt_s)));
    let k4 = derivative(&(x + k3 * dt_s));
    x + (k1 + (k2 + k3) * 2.0 + k4) * (dt_s / 6.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    /// Largest error over one period of `z'' = -z` from (1, 0).
    fn error(steps: usize) -> f64 {
        let dt = std::f64::consts::TAU / steps as f64;
        let mut x = Vector2::new(1.0, 0.0);
        for _ in 0..steps {
            x = runge_kutta_4(&x, dt, |x| Vector2::new(x[1], -x[0]));
        }
        (x - Vector2::new(1.0, 0.0)).norm()
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

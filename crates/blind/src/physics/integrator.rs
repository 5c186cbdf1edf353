//! Dormand and Prince's embedded Runge-Kutta pair of orders 5 and 4 with step-size control.
//!
//! Source: Dormand, Prince, A family of embedded Runge-Kutta formulae, Journal of Computational and Applied
//! Mathematics 6(1), 1980; step control after Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I,
//! section II.4.

const A: [[f64; 6]; 6] = [
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
const C: [f64; 6] = [1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// Fifth-order weights less the fourth-order ones.
const ERROR: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];

const ABSOLUTE: f64 = 1e-8;
const RELATIVE: f64 = 1e-6;
/// A step as short as this is taken whatever its error: contact and switched laws have kinks.
const SHORTEST_S: f64 = 2e-5;

/// The integrator's memory between calls: the step that the error allows.
#[derive(Clone, Debug)]
pub(crate) struct Integrator {
    step_s: f64,
}

impl Integrator {
    pub(crate) fn new() -> Self {
        Self { step_s: 1e-3 }
    }

    /// Takes `state` from `from_s` to `to_s` under `rates`, which must be smooth in time between the two.
    pub(crate) fn advance<const N: usize>(
        &mut self,
        from_s: f64,
        to_s: f64,
        state: &mut [f64; N],
        rates: impl Fn(f64, &[f64; N]) -> [f64; N],
    ) {
        let mut t = from_s;
        while to_s - t > 1e-12 {
            let left = to_s - t;
            let h = self.step_s.min(left);
            let (next, error) = step(t, h, state, &rates);
            let accepted = error <= 1.0 || h <= SHORTEST_S;
            if accepted {
                *state = next;
                t += h;
            }
            let factor = if error > 0.0 { (0.9 * error.powf(-0.2)).clamp(0.2, 5.0) } else { 5.0 };
            // A step that was cut short by the end says nothing against a longer one.
            if !accepted || h >= self.step_s || factor < 1.0 {
                self.step_s = (h * factor).max(SHORTEST_S);
            }
        }
    }
}

/// One step of length `h`: the fifth-order solution and its error in units of the tolerance.
fn step<const N: usize>(
    t: f64,
    h: f64,
    state: &[f64; N],
    rates: &impl Fn(f64, &[f64; N]) -> [f64; N],
) -> ([f64; N], f64) {
    let mut k = [[0.0; N]; 7];
    k[0] = rates(t, state);
    let mut next = *state;
    for stage in 0..6 {
        next = *state;
        for (i, x) in next.iter_mut().enumerate() {
            *x += h * (0..=stage).map(|j| A[stage][j] * k[j][i]).sum::<f64>();
        }
        k[stage + 1] = rates(t + C[stage] * h, &next);
    }
    let mut error: f64 = 0.0;
    for i in 0..N {
        let difference = h * (0..7).map(|j| ERROR[j] * k[j][i]).sum::<f64>();
        let scale = ABSOLUTE + RELATIVE * state[i].abs().max(next[i].abs());
        error = error.max((difference / scale).abs());
    }
    (next, error)
}

#[cfg(test)]
mod tests {
    use super::Integrator;

    #[test]
    fn an_oscillator_keeps_its_energy_to_the_tolerance() {
        let mut state = [1.0, 0.0];
        Integrator::new().advance(0.0, 10.0, &mut state, |_, [x, v]| [*v, -25.0 * x]);
        // Local errors of 1e-6 over some hundred steps.
        assert!((state[0] - 50.0_f64.cos()).abs() < 1e-3, "{state:?}");
        assert!((state[0].powi(2) + (state[1] / 5.0).powi(2) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_stiff_decay_ends_where_it_should() {
        let mut state = [1.0];
        Integrator::new().advance(0.0, 2.0, &mut state, |t, [x]| [-500.0 * (x - t)]);
        assert!((state[0] - (2.0 - 1.0 / 500.0)).abs() < 1e-5, "{state:?}");
    }
}

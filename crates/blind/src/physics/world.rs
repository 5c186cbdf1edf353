//! One flight's world: it goes on from instant to instant, and is stopped where something changes.

use bench_rig::Rig;

use super::{
    air::{self, GRID_S},
    body::{Body, STATES},
    integrator::Integrator,
    law::Now,
};

/// Random series of a flight, on the grid.
#[derive(Debug)]
pub(crate) struct Series {
    /// Turbulence, m/s.
    pub turbulence: Vec<f64>,
    /// Gusts, m/s; empty without.
    pub gust: Vec<f64>,
    /// A motor that misses; empty without.
    pub miss: Vec<f64>,
}

/// Where and when a flight takes place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Setting {
    /// The flight's beginning after that of the case, min.
    pub begins_min: f64,
    /// Nominal weight, N.
    pub weight_n: f64,
    /// Nominal hover throttle, in units of the sticks.
    pub hover: f64,
}

impl Setting {
    pub(crate) fn of(rig: &Rig, begins_min: f64) -> Self {
        let weight_n = rig.airframe.weight_n();
        Self { begins_min, weight_n, hover: rig.airframe.throttle_for(weight_n) }
    }

    pub(crate) fn now(
        &self,
        t_s: f64,
        z_m: f64,
        v_m_s: f64,
        heard: f64,
        series: &Series,
        gusty: bool,
    ) -> Now {
        let gust = if gusty { air::at(&series.gust, t_s) } else { 0.0 };
        Now {
            t_s,
            session_min: self.begins_min + t_s / 60.0,
            z_m,
            v_m_s,
            heard,
            air_m_s: air::at(&series.turbulence, t_s) + gust,
            miss: air::at(&series.miss, t_s),
            weight_n: self.weight_n,
            hover: self.hover,
        }
    }
}

/// The airframe on its way.
pub(crate) struct World<'a> {
    pub body: Body<'a>,
    pub setting: Setting,
    pub series: Series,
    pub t_s: f64,
    /// What the motors hear.
    pub heard: f64,
    state: [f64; STATES],
    integrator: Integrator,
    /// Altitude and speed at each point of the grid passed.
    pub path: Vec<[f64; 2]>,
}

impl<'a> World<'a> {
    pub(crate) fn new(body: Body<'a>, setting: Setting, series: Series, rest: f64) -> Self {
        let state = body.start();
        let path = vec![[state[0], state[1]]];
        Self { body, setting, series, t_s: 0.0, heard: rest, state, integrator: Integrator::new(), path }
    }

    pub(crate) fn altitude_m(&self) -> f64 {
        self.state[0]
    }

    /// Thrust over nominal weight.
    pub(crate) fn load(&self) -> f64 {
        let [z_m, v_m_s, memory @ ..] = &self.state;
        let now = self.setting.now(self.t_s, *z_m, *v_m_s, self.heard, &self.series, true);
        self.body.evaluate(&now, memory).1
    }

    /// Goes on to `to_s`, point by point of the grid.
    pub(crate) fn advance(&mut self, to_s: f64) {
        while self.t_s < to_s {
            let grid_s = self.path.len() as f64 * GRID_S;
            let next_s = grid_s.min(to_s);
            let (body, setting, series, heard) = (&self.body, &self.setting, &self.series, self.heard);
            self.integrator.advance(self.t_s, next_s, &mut self.state, |t_s, [z_m, v_m_s, memory @ ..]| {
                let now = setting.now(t_s, *z_m, *v_m_s, heard, series, true);
                let (acceleration, _, inner) = body.evaluate(&now, memory);
                let mut rates = [0.0; STATES];
                rates[0] = *v_m_s;
                rates[1] = acceleration + Body::floor(*z_m, *v_m_s);
                rates[2..].copy_from_slice(&inner);
                rates
            });
            self.t_s = next_s;
            if next_s == grid_s {
                self.path.push([self.state[0], self.state[1]]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::body::Numbers;

    /// Mass 15 g, drag 0.012 N s/m, 0.1 N/V from 0.5 V on, no ground effect, no latency.
    const NUMBERS: Numbers = Numbers([0.015, 0.012, 0.1, 0.5, 1.0, 0.05, 0.0]);
    const WEIGHT_N: f64 = 0.015 * bench_rig::GRAVITY_M_S2;

    fn still_air() -> Series {
        Series { turbulence: vec![0.0; 10], gust: Vec::new(), miss: Vec::new() }
    }

    fn world() -> World<'static> {
        let body = Body { numbers: NUMBERS, trim: 1.0, drain_per_min: 0.0, laws: Vec::new() };
        let setting = Setting { begins_min: 0.0, weight_n: WEIGHT_N, hover: 0.5 + WEIGHT_N / 0.1 };
        World::new(body, setting, still_air(), 0.0)
    }

    #[test]
    fn a_climb_under_linear_drag_is_the_closed_form() {
        let mut world = world();
        world.heard = 0.5 + 1.2 * WEIGHT_N / 0.1;
        world.advance(2.0);
        let (rate, steady_m_s) = (0.012 / 0.015, 0.2 * WEIGHT_N / 0.012);
        let grown = 1.0 - (-rate * 2.0_f64).exp();
        let [z_m, v_m_s] = world.path[400];
        // Skids that spring back give at most g over their frequency, 0.08 m/s, of which drag leaves a fifth: 1 % of
        // the speed; of the way, 0.08 m/s for a drag's time of 1.25 s.
        assert!((v_m_s / (steady_m_s * grown) - 1.0).abs() < 0.01, "{v_m_s}");
        assert!((z_m / (steady_m_s * (2.0 - grown / rate)) - 1.0).abs() < 0.04, "{z_m}");
    }

    #[test]
    fn a_lid_holds_an_airframe_that_pushes_against_it() {
        let lid = crate::physics::environment::ImageCeiling { gain: 0.05, ceiling_m: 0.8, radius_m: 0.05 };
        let laws: Vec<&dyn crate::physics::law::Law> = vec![&lid];
        let mut world = World { body: Body { laws, ..world().body }, ..world() };
        world.heard = 0.5 + 1.1 * WEIGHT_N / 0.1;
        world.advance(6.0);
        let highest_m = world.path.iter().map(|[z_m, _]| *z_m).fold(0.0, f64::max);
        // It comes at less than sqrt(2 x 0.1 g x 0.8 m), 1.3 m/s, which the guards stop within that over their frequency.
        assert!((0.8..0.811).contains(&highest_m), "{highest_m}");
        // Thrust of 1.15 weights presses 0.15 g into them, a tenth of a millimetre.
        let [z_m, v_m_s] = world.path[world.path.len() - 1];
        assert!((z_m - 0.8001).abs() < 5e-5 && v_m_s.abs() < 1e-3, "{z_m} {v_m_s}");
    }

    #[test]
    fn at_rest_the_airframe_stays_on_the_floor() {
        let mut world = world();
        world.advance(1.0);
        assert!(world.path.iter().all(|[z_m, v_m_s]| z_m.abs() < 1e-3 && v_m_s.abs() < 1e-3));
    }
}

//! The extended Kalman filter over a flight: propagates through the law, learns from measurements, and is reset by ground, ceiling and
//! hands.

use bench_plant::effects::Axis;
use bench_rig::Rig;

use crate::{
    covariance::{
        CARRIED_M_S, Covariance, State, Transition, initial_covariance, lift_off_covariance,
        predicted_variance, reset_covariance, stop_covariance, update_along, update_by_altitude,
    },
    law::{Hold, Law, Point},
    measurement::{AltitudeMeasurement, Scored},
    noise::Noise,
    passenger::{Flown, Measured, Passenger, Propagated, Reset, Updated},
    track::{Felt, Measurement, Track, held},
};

/// Time constant against which a change of thrust is taken, s.
const CHANGE_TIME_S: f64 = 0.3;
/// Time constant for which the air about an airframe may remember where it was, s.
const PAST_TIME_S: f64 = 2.0; // numerical
/// Differences over which the force's slopes are taken, m and m/s: small against the ground effect's 5 cm.
const DZ: f64 = 1e-4; // numerical
const DV: f64 = 1e-3; // numerical
/// For so long laws are held at what was there before the flight, s: they settle on it.
const AT_REST_S: f64 = 1e-6; // numerical
/// Steps up to this long, s, are made by the midpoint rule, longer ones by that of Runge and Kutta. One such step leads to a measurement
/// that is no further off, with the mean thrust, whatever edges the throttle has on the way: if it steps by a tenth of the weight there,
/// altitude is off by a hundredth of a millimetre.
const SHORT_STEP_S: f64 = 0.012; // numerical
/// Longest integration step, s, and the longest near the ground, where the air changes within centimetres.
const STEP_S: f64 = 0.1001; // numerical
const NEAR_GROUND_STEP_S: f64 = 0.034; // numerical
/// Near the ground a step leads no further than this share of the ground effect's height, and is no shorter than this, s;
/// near is nearer than so many of its heights.
const STEP_OF_GROUND_EFFECT: f64 = 0.125; // numerical
const LEAST_STEP_S: f64 = 0.003; // numerical
const NEAR_HEIGHTS: f64 = 3.0; // numerical
/// Of so many correlation times at most a step is short.
const SHORT: f64 = 0.2; // numerical
/// Below this altitude the ground effect's kink makes the model uncertain, m.
pub const NEAR_GROUND_M: f64 = 0.07;
/// Seen so many sigma above a ceiling, twice in a row, an airframe was not stopped by it.
const ABOVE_SIGMAS: f64 = 3.0;
/// The speed of an airframe that is carried is taken from measurements so close, s.
const SPEED_WITHIN_S: f64 = 0.3;

/// What hats and plays look at, besides the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Surroundings {
    ratio: f64,
    lagged_ratio: f64,
    elapsed_s: f64,
    charge_min: f64,
    voltage: f64,
    lagged_altitude_m: f64,
}

struct Filter {
    noise: Noise,
    law: Law,
    x: State,
    p: Covariance,
    around: Surroundings,
    standing: bool,
    /// Whether the airframe is carried, and where and when it was last seen so.
    carried: bool,
    carried_at: Option<(f64, f64)>,
    /// Whether the last measurement counted.
    counting: bool,
    /// When and where the airframe was last seen.
    last_seen: Option<(f64, f64)>,
    /// How probably the last measurement was of an older frame than its own.
    stale: f64,
    /// Negative log-likelihood.
    nll: f64,
    step_m: f64,
    frame_s: f64,
    ratio_per_unit: f64,
    offset: f64,
    /// Where the airframe is stopped from above, m.
    ceiling_m: f64,
    /// Height below which the ground bends a flight, m.
    ground_effect_m: f64,
    /// What the pin holds over the step at hand.
    holds: Vec<Hold>,
}

/// What of a flight the filter learns from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum LearnsFrom {
    /// The tracker alone.
    Tracker,
    /// Also what was felt on board, where its noise is known.
    All,
}

/// Runs the filter over a track at a point, with what goes along; the negative log-likelihood, but for constants.
pub(crate) fn fly(
    track: &Track,
    rig: &Rig,
    point: &Point,
    noise: &Noise,
    learns_from: LearnsFrom,
    passengers: &mut impl Passenger,
) -> f64 {
    let mut filter = Filter::new(track, rig, point, noise);
    filter.fly(track, rig, learns_from, passengers);
    filter.nll
}

impl Filter {
    fn new(track: &Track, rig: &Rig, point: &Point, noise: &Noise) -> Self {
        let noise = noise.times(track.ln_noise.exp());
        let law = Law::new(point, rig);
        Self {
            ceiling_m: stopping_m(&law, track, &noise),
            law,
            x: [0.0; 4],
            p: initial_covariance(&noise),
            around: Surroundings { ratio: 0.0, lagged_ratio: 1.0, ..Surroundings::default() },
            standing: true,
            carried: false,
            carried_at: None,
            counting: false,
            last_seen: None,
            stale: noise.stale_probability,
            nll: 0.0,
            step_m: rig.tracker.resolution_m.max(1e-4), // numerical
            frame_s: rig.tracker.frame_period_s,
            ratio_per_unit: rig.airframe.thrust.gain_n_per_unit.value / rig.airframe.weight_n(),
            offset: rig.airframe.thrust.offset.value,
            ground_effect_m: rig.airframe.ground_effect.height_m.value,
            noise,
            holds: Vec::new(),
        }
    }

    fn fly(&mut self, track: &Track, rig: &Rig, learns_from: LearnsFrom, passengers: &mut impl Passenger) {
        let mut now = track.begin_s;
        let mut input = track.inputs.partition_point(|input| input.time_s <= now).max(1) - 1;
        // What lags comes from what was held at rest, not from the launch; in the air, from what is first known.
        if let Some(before) = input.checked_sub(1).or(track.begins_aloft.then_some(input)) {
            self.holds.push(Hold { h: AT_REST_S, throttle: track.inputs[before].throttle });
            self.law.hold(&self.holds);
            self.law.advance(AT_REST_S, 0.0, 0.0);
            passengers.propagated(&self.held(AT_REST_S));
        }
        let late = self.law.view.latency_s - rig.tracker.latency_s.value;
        let feels = self.noise.velocity_m_s.max(self.noise.acceleration_m_s2) > 0.0;
        let mut felt = if feels && learns_from == LearnsFrom::All { track.felt.as_slice() } else { &[] };
        for measurement in &track.measurements {
            self.carried = measurement.carried;
            let at = measurement.exposed_s - late;
            while now < at {
                self.look_at_channels(track, now);
                let until = at.min(felt.first().map_or(f64::INFINITY, |felt| felt.time_s.max(now)));
                if now < until {
                    now = self.step(track, &mut input, now, until, passengers);
                }
                while let Some((first, rest)) = felt.split_first().filter(|(first, _)| first.time_s <= now) {
                    self.on_board_update(first, passengers);
                    felt = rest;
                }
            }
            if self.carried {
                self.reset_to_measurement(measurement, passengers);
            } else {
                self.measurement_update(measurement, track.timing_s, passengers);
            }
        }
    }

    /// Makes a step towards `until`, s, from where the pin holds the track's input `input`; when it ends.
    fn step(
        &mut self,
        track: &Track,
        input: &mut usize,
        now: f64,
        until: f64,
        passengers: &mut impl Passenger,
    ) -> f64 {
        let edge = |input: usize| track.inputs.get(input + 1).map_or(f64::INFINITY, |next| next.time_s);
        while edge(*input) <= now {
            *input += 1;
        }
        let longest_s = self.longest_step_s();
        self.holds.clear();
        if until - now <= SHORT_STEP_S.min(longest_s) {
            let mut from = now;
            while edge(*input) < until {
                self.holds.push(Hold { h: edge(*input) - from, throttle: track.inputs[*input].throttle });
                from = edge(*input);
                *input += 1;
            }
            self.holds.push(Hold { h: until - from, throttle: track.inputs[*input].throttle });
            self.time_update(until - now, passengers);
            return until;
        }
        let end = until.min(edge(*input));
        let left = end - now;
        let steps = (left / longest_s).ceil();
        self.holds.push(Hold { h: left / steps, throttle: track.inputs[*input].throttle });
        self.time_update(left / steps, passengers);
        if steps > 1.0 { now + left / steps } else { end }
    }

    /// How long the next step may be: fast through the ground effect, a flight is bent within a few hundredths of a second.
    fn longest_step_s(&self) -> f64 {
        let [z, v, ..] = self.x;
        if z - STEP_S * v.abs() > NEAR_HEIGHTS * self.ground_effect_m {
            return STEP_S;
        }
        let through_s = STEP_OF_GROUND_EFFECT * self.ground_effect_m / v.abs().max(f64::MIN_POSITIVE);
        through_s.clamp(LEAST_STEP_S, NEAR_GROUND_STEP_S)
    }

    /// A step over which the airframe did not follow the law.
    fn held(&self, h: f64) -> Propagated<'_> {
        let [z, v, ..] = self.x;
        Propagated {
            h,
            holds: &self.holds,
            law: &self.law,
            from: [z, v],
            ratio: self.around.ratio,
            flown: None,
        }
    }

    fn time_update(&mut self, h: f64, passengers: &mut impl Passenger) {
        let [z, v, b, w] = self.x;
        self.look_around(h);
        self.law.hold(&self.holds);
        self.law.advance(h, z, v);
        let a0 = self.law.acceleration_m_s2(z, v);
        if self.carried {
            passengers.propagated(&self.held(h));
            return;
        }
        if z <= 0.0 && v <= 0.0 && a0 + b + w <= 0.0 {
            passengers.propagated(&self.held(h));
            passengers.reset(&Reset::Standing);
            self.standing = true;
            return;
        }
        if self.standing {
            self.standing = false;
            lift_off_covariance(&mut self.p, self.noise.lift_off_m_s);
            passengers.reset(&Reset::LiftOff(self.noise.lift_off_m_s));
        }
        // What depends on the way there is taken in its middle.
        let a = a0 + b + w;
        let half = h / 2.0;
        let after = |dt: f64, speed: f64, a: f64| [(z + dt * speed).max(0.0), v + dt * a];
        let first = after(half, v, a);
        let mut force = self.law.acceleration_m_s2(first[0], first[1]);
        let a1 = force + b + w;
        let (middle, mut z1, mut v1);
        if h <= SHORT_STEP_S {
            middle = first;
            z1 = z + h * first[1];
            v1 = v + h * a1;
        } else {
            middle = after(half, first[1], a1);
            force = self.law.acceleration_m_s2(middle[0], middle[1]);
            let a2 = force + b + w;
            let end = after(h, middle[1], a2);
            let a3 = self.law.acceleration_m_s2(end[0], end[1]) + b + w;
            z1 = z + h * (v + h * (a + a1 + a2) / 6.0); // unit
            v1 = v + h * (a + 2.0 * (a1 + a2) + a3) / 6.0; // unit
        }
        let (az, av) = self.slopes(middle, force);
        let kept = kept(h / self.noise.turbulence_time_s);
        let push = h * h / 2.0;
        let lift = h * (1.0 + av * h / 2.0);
        let transition = Transition {
            z: [1.0 + az * push, lift, push],
            v: [az * h, 1.0 + av * h + (az + av * av) * push, lift],
            kept,
        };
        let near_ground = z < NEAR_GROUND_M;
        transition.propagate_covariance(&mut self.p, h, near_ground, &self.noise);
        let flown = Flown { middle, force, transition: &transition, near_ground, axes: &self.axes() };
        passengers.propagated(&Propagated { flown: Some(flown), ..self.held(h) });
        if z1 <= 0.0 {
            z1 = 0.0;
            if v1 < 0.0 {
                v1 = 0.0;
                stop_covariance(&mut self.p);
                passengers.reset(&Reset::Stopped { ceiling_m: None });
            }
        }
        if z1 >= self.ceiling_m {
            z1 = self.ceiling_m;
            v1 = v1.min(0.0);
            stop_covariance(&mut self.p);
            passengers.reset(&Reset::Stopped { ceiling_m: Some(self.law.ceiling_m) });
        }
        self.x = [z1, v1, b, w * kept];
    }

    fn look_at_channels(&mut self, track: &Track, now_s: f64) {
        if !track.tilt.is_empty() {
            self.law.tilt_cos = held(&track.tilt, now_s).unwrap_or(1.0);
        }
        if !track.voltage.is_empty() {
            self.around.voltage = held(&track.voltage, now_s).unwrap_or(track.voltage[0].1);
        }
    }

    fn look_around(&mut self, h: f64) {
        let around = &mut self.around;
        let impulse = |hold: &Hold| (self.ratio_per_unit * (hold.throttle - self.offset)).max(0.0) * hold.h;
        around.ratio = self.holds.iter().map(impulse).sum::<f64>() / h;
        around.lagged_ratio += (around.ratio - around.lagged_ratio) * settled(h / CHANGE_TIME_S);
        around.elapsed_s += h;
        around.charge_min += around.ratio * h / 60.0; // unit
        around.lagged_altitude_m += (self.x[0] - around.lagged_altitude_m) * settled(h / PAST_TIME_S);
    }

    /// The quantities of [`Axis::ALL`].
    fn axes(&self) -> [f64; Axis::COUNT] {
        let around = &self.around;
        let change = around.ratio - around.lagged_ratio;
        [
            self.x[0],
            self.x[1],
            around.ratio,
            change,
            around.elapsed_s,
            around.charge_min,
            around.voltage,
            around.lagged_altitude_m,
        ]
    }

    /// Slopes of the law's acceleration by altitude and speed where it is `force`.
    fn slopes(&self, [z, v]: [f64; 2], force: f64) -> (f64, f64) {
        let at = |z: f64, v: f64| self.law.acceleration_m_s2(z, v);
        ((at(z + DZ, v) - at(z - DZ, v)) / (2.0 * DZ), (at(z, v + DV) - force) / DV)
    }

    /// Takes the airframe to be where it is seen. What a flight keeps, its trim, is kept; the rest begins anew.
    fn reset_to_measurement(&mut self, measurement: &Measurement, passengers: &mut impl Passenger) {
        let z = self.law.view.altitude_m(measurement.z_m).max(0.0);
        let speed = self.carried_at.replace((measurement.exposed_s, z)).map_or(0.0, |(time_s, from)| {
            let since_s = measurement.exposed_s - time_s;
            if (1e-4..SPEED_WITHIN_S).contains(&since_s) { (z - from) / since_s } else { 0.0 } // numerical
        });
        let v = speed.clamp(-CARRIED_M_S, CARRIED_M_S);
        self.x = [z, v, self.x[2], 0.0];
        self.standing = false;
        reset_covariance(&mut self.p, &self.noise);
        passengers.reset(&Reset::Carried { law: &self.law, exposed_s: measurement.exposed_s, at: [z, v] });
    }

    /// Holds a measurement against its prediction and learns from it.
    fn measurement_update(
        &mut self,
        measurement: &Measurement,
        timing_s: f64,
        passengers: &mut impl Passenger,
    ) {
        let [z, v, ..] = self.x;
        let (factor, predicted_m) = (self.law.view.slope(z), self.law.view.seen_m(z));
        let residual = measurement.z_m - predicted_m;
        let (last_s, last_m) = self.last_seen.unwrap_or((f64::MIN, f64::NAN));
        let of = AltitudeMeasurement {
            factor,
            speed_m_s: v,
            timing_s,
            repeats: last_m == measurement.z_m,
            flies: last_m > NEAR_GROUND_M,
            from_last_m: last_m - predicted_m,
            step_m: self.step_m,
            frame_s: self.frame_s,
            since_s: measurement.exposed_s - last_s,
        };
        self.last_seen = Some((measurement.exposed_s, measurement.z_m));
        let scored = of.score(&self.p, &self.noise, residual, self.stale);
        self.stale = scored.stale;
        self.counting = measurement.counts;
        let (x, p, axes) = (self.x, self.p, self.axes());
        let gain = update_by_altitude(&mut self.p, factor, &scored);
        let below_ceiling_m = self.ceiling_m - z;
        let measured = Measured::Altitude { measurement, of: &of, predicted_m, below_ceiling_m };
        self.state_update(measured, residual, scored, (&x, &p), gain, &axes, passengers);
    }

    /// Holds what was felt on board against its prediction and learns from it, where a measurement would count.
    fn on_board_update(&mut self, felt: &Felt, passengers: &mut impl Passenger) {
        if self.standing || self.carried || !self.counting {
            return;
        }
        if let Some(velocity) = felt.velocity_m_s.filter(|_| self.noise.velocity_m_s > 0.0) {
            let residual = velocity - self.x[1];
            self.scalar_update(residual, [0.0, 1.0, 0.0, 0.0], self.noise.velocity_m_s, None, passengers);
        }
        if let Some(acceleration) = felt.acceleration_m_s2.filter(|_| self.noise.acceleration_m_s2 > 0.0) {
            let [z, v, b, w] = self.x;
            let force = self.law.acceleration_m_s2(z, v);
            let (az, av) = self.slopes([z, v], force);
            let residual = acceleration - (force + b + w);
            self.scalar_update(
                residual,
                [az, av, 1.0, 1.0],
                self.noise.acceleration_m_s2,
                Some(force),
                passengers,
            );
        }
    }

    /// Takes a measurement on board with slopes by the state.
    fn scalar_update(
        &mut self,
        residual: f64,
        slopes: State,
        sigma: f64,
        force: Option<f64>,
        passengers: &mut impl Passenger,
    ) {
        let scored = Scored::bounded(residual, predicted_variance(&self.p, &slopes) + sigma * sigma);
        let (x, p, axes) = (self.x, self.p, self.axes());
        let gain = update_along(&mut self.p, &slopes, &scored);
        let measured = Measured::OnBoard { slopes, sigma, force };
        self.state_update(measured, residual, scored, (&x, &p), gain, &axes, passengers);
    }

    /// Moves the state by what was measured, once the covariance has learnt it, and tells it.
    #[expect(clippy::too_many_arguments, reason = "what was known before, and what came of it")]
    fn state_update(
        &mut self,
        measured: Measured<'_>,
        residual: f64,
        scored: Scored,
        before: (&State, &Covariance),
        gain: State,
        axes: &[f64; Axis::COUNT],
        passengers: &mut impl Passenger,
    ) {
        if self.counting {
            self.nll += scored.nll;
        }
        for (x, k) in self.x.iter_mut().zip(gain) {
            *x += k * scored.residual;
        }
        self.x[0] = self.x[0].min(self.ceiling_m).max(0.0);
        passengers.updated(&Updated {
            measured,
            residual,
            scored,
            counts: self.counting,
            law: &self.law,
            before,
            after: (&self.x, &self.p),
            gain,
            axes,
        });
    }
}

/// How much of its way to a held target a first-order lag goes in a step, of `x` time constants: to a thousandth where `x` is a tenth,
/// without an exponential in every step.
#[inline]
fn settled(x: f64) -> f64 {
    x / (1.0 + 0.5 * x)
}

/// What an Ornstein-Uhlenbeck process keeps over a step of `x` correlation times: `exp(-x)`, where steps are short by its approximant
/// of Pade, which is off by less than `x^5/720`; nothing where it has no correlation time.
#[inline]
fn kept(x: f64) -> f64 {
    if x < SHORT {
        let (even, odd) = (1.0 + x * x / 12.0, 0.5 * x); // unit
        (even - odd) / (even + odd)
    } else if x.is_finite() {
        (-x).exp()
    } else {
        0.0
    }
}

/// Where a law's ceiling stops the airframe, m: not where it was seen above.
fn stopping_m(law: &Law, track: &Track, noise: &Noise) -> f64 {
    let above_m = law.view.seen_m(law.ceiling_m) + ABOVE_SIGMAS * noise.measurement_m;
    if law.ceiling_m.is_finite() && track.highest_m() > above_m { f64::INFINITY } else { law.ceiling_m }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_plant::effects::index_of;

    use super::*;

    #[test]
    fn a_ceiling_does_not_stop_what_was_seen_above_it() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let mut point = Point::nominal(&rig).0;
        let noise = Noise::nominal(&rig);
        let seen = |altitudes: &[f64]| {
            let measurement = |z_m: &f64| Measurement {
                exposed_s: 0.0,
                believed_s: 0.0,
                z_m: *z_m,
                counts: true,
                carried: false,
            };
            Track { measurements: altitudes.iter().map(measurement).collect(), ..Track::default() }
        };
        let below = seen(&[0.3, 0.705, 0.705, 0.5]);
        assert_eq!(stopping_m(&Law::new(&point, &rig), &below, &noise), f64::INFINITY);
        point.effects = vec![(index_of("ceiling-effect").unwrap(), vec![0.1, 0.7, 0.05, 1.0])];
        let law = Law::new(&point, &rig);
        assert_eq!(stopping_m(&law, &below, &noise), 0.7, "half a centimetre above is within three sigma");
        assert_eq!(
            stopping_m(&law, &seen(&[0.5, 0.9, 0.5]), &noise),
            0.7,
            "one measurement may be of anything"
        );
        assert_eq!(stopping_m(&law, &seen(&[0.5, 0.9, 0.9, 0.5]), &noise), f64::INFINITY);
    }
}

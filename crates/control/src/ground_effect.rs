//! What the ground adds to the thrust, for laws that reckon with it.

use bench_rig::Airframe;

/// The nominal ground effect, `1 + (multiplier - 1) max(0, 1 - z/height)` (paper, section 3.4, figure 10).
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundEffect {
    extra: f64,
    height_m: f64,
}

/// Within this share of the ground effect's height about the set-point, the law leaves altitude to the ground effect
/// itself: a spring stiffer than any loop through the delay.
const SPRING: f64 = 0.4;

/// Rate at which a landing goes through the ground effect at most, in its heights a second: 0.1 m/s where it is 5 cm high.
const TOUCH_DOWN_HEIGHTS_PER_S: f64 = 2.0;
/// Where a landing's set-point ends, in heights of the ground effect.
const DOWN_HEIGHTS: f64 = -0.6;

/// Where a descent is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Descent {
    /// m; below the ground in the end.
    pub(crate) setpoint_m: f64,
    /// m/s, negative.
    pub(crate) speed_m_s: f64,
    /// The set-point goes no lower.
    pub(crate) ended: bool,
}

impl GroundEffect {
    pub(crate) fn new(airframe: &Airframe) -> Self {
        Self {
            extra: airframe.ground_effect.multiplier.value - 1.0,
            height_m: airframe.ground_effect.height_m.value,
        }
    }

    /// Thrust at an altitude over thrust far from the ground. Below the ground it goes on rising, for set-points that
    /// are to bring the airframe firmly down.
    pub(crate) fn multiplier(&self, z_m: f64) -> f64 {
        1.0 + self.extra * (1.0 - z_m / self.height_m).max(0.0)
    }

    /// Its slope, 1/m.
    pub(crate) fn slope_per_m(&self, z_m: f64) -> f64 {
        if (0.0..self.height_m).contains(&z_m) { -self.extra / self.height_m } else { 0.0 }
    }

    /// Set-point and its speed so long after a descent began: at the rate asked for down to the ground effect, no faster
    /// than is good for a touch-down within it, and on to where the airframe must stand. There the law asks for less
    /// thrust than lifts off: `multiplier(0)/multiplier(down)` of the weight.
    pub(crate) fn descent(&self, from_m: f64, rate_m_s: f64, elapsed_s: f64) -> Descent {
        let slow_m_s = rate_m_s.min(TOUCH_DOWN_HEIGHTS_PER_S * self.height_m);
        let down_m = DOWN_HEIGHTS * self.height_m;
        let fast_s = ((from_m - self.height_m) / rate_m_s).max(0.0);
        if elapsed_s < fast_s {
            return Descent { setpoint_m: from_m - rate_m_s * elapsed_s, speed_m_s: -rate_m_s, ended: false };
        }
        let setpoint_m = from_m.min(self.height_m) - slow_m_s * (elapsed_s - fast_s);
        if setpoint_m > down_m {
            Descent { setpoint_m, speed_m_s: -slow_m_s, ended: false }
        } else {
            Descent { setpoint_m: down_m, speed_m_s: 0.0, ended: true }
        }
    }

    /// What to divide the thrust by on the way to a set-point. Near it that is the multiplier at the set-point, which keeps
    /// the spring; further off it is the multiplier where the airframe is, so that the spring does not throw it.
    pub(crate) fn towards(&self, setpoint_m: f64, altitude_m: f64) -> f64 {
        let spring_m = SPRING * self.height_m;
        let off_m = (altitude_m - setpoint_m).clamp(-spring_m, spring_m);
        self.multiplier(altitude_m - off_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const Q4: GroundEffect = GroundEffect { extra: 0.3, height_m: 0.05 };

    #[test]
    fn thrust_is_divided_by_what_holds_at_the_set_point_or_where_the_airframe_is() {
        assert!((Q4.multiplier(0.03) - 1.12).abs() < 1e-12);
        // Near the set-point the spring stays.
        assert_eq!(Q4.towards(0.03, 0.04), Q4.multiplier(0.03));
        // Far above it nothing is taken off but what acts there, 2 cm nearer the set-point.
        assert_eq!(Q4.towards(0.03, 0.25), 1.0);
        assert_eq!(Q4.towards(0.4, 0.0), Q4.multiplier(0.02));
    }

    #[test]
    fn a_descent_is_continuous_slows_down_and_ends_below_the_ground() {
        let mut last = Q4.descent(0.4, 0.15, 0.0);
        assert_eq!(last.setpoint_m, 0.4);
        for i in 1..600 {
            let next = Q4.descent(0.4, 0.15, f64::from(i) * 0.01);
            let fallen = last.setpoint_m - next.setpoint_m;
            assert!((0.0..=0.0015 + 1e-12).contains(&fallen), "{next:?}");
            assert!(
                next.setpoint_m > Q4.height_m || fallen <= 0.001 + 1e-12 || last.setpoint_m > Q4.height_m
            );
            last = next;
        }
        assert_eq!(last, Descent { setpoint_m: -0.03, speed_m_s: 0.0, ended: true });
    }
}

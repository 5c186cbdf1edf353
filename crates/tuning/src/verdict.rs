//! Figures held against their limits, and what that says of a tuning.

use bench_page::digits;
use serde::Serialize;

use crate::{
    figures::Figures,
    margins::Margins,
    statistics::percentile_between,
    tune::{Limits, LoopKind, SHARE, Tuned, Tuning},
};

/// Share of the fresh airframes that must hold within the limit of RMS.
pub const HOLDING: f64 = 0.99;

/// How a figure stands to its limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// Within it.
    Held,
    /// Beyond it, but by less than it is known to.
    AtLimit,
    /// Beyond it.
    Broken,
}

/// A figure, in the unit that its name tells, held against its limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// What it is, with its unit.
    pub name: &'static str,
    /// With the rig's gains; absent where the loop is not stable, or knows no such margin.
    pub before: Option<f64>,
    /// With the gains found, likewise.
    pub after: Option<f64>,
    /// Interval of 95 % of `after`; absent for margins, which are exact.
    pub between: Option<[f64; 2]>,
    /// The limit: at most for figures of flights, at least for margins.
    pub limit: f64,
    /// How `after` stands to it.
    pub standing: Standing,
}

impl Judged {
    /// `after` and the limit, with so many digits that they can be told apart.
    pub fn apart(&self) -> [String; 2] {
        let value = self.after.unwrap_or(f64::INFINITY);
        [told(value, self.limit), digits(self.limit)]
    }
}

/// A number with as many digits as tell it from another one, three at least.
fn told(x: f64, from: f64) -> String {
    const MOST: usize = 7;
    let plain = digits(x);
    if x == from || plain != digits(from) {
        return plain;
    }
    // From the three digits of the plain words on.
    let least = (2 - x.abs().log10().floor() as i32).max(0) as usize;
    let mut more = (least.min(MOST)..=MOST).map(|places| format!("{x:.places$}"));
    more.find(|text| text.parse() != Ok(from)).unwrap_or(plain)
}

/// Name, factor to its unit, figure of a flight, limit.
type OfFlights = (&'static str, f64, fn(&Figures) -> f64, f64);
/// Name, margin of a loop, limit.
type OfLoop = (&'static str, fn(&Margins) -> Option<f64>, f64);

/// All limits of a loop: figures of fresh airframes with the rig's gains and those found, and the margins of both.
pub(crate) fn judge(
    of: LoopKind,
    limits: &Limits,
    flown: [&[Option<Figures>]; 2],
    margins: [Option<Margins>; 2],
) -> Vec<Judged> {
    let activity = match of {
        LoopKind::Altitude => "activity, % of weight",
        LoopKind::Lateral => "activity, % of gravity",
    };
    let of_flights: [OfFlights; 4] = [
        ("RMS in hold, cm", 100.0, |f| f.rms_m, limits.rms_m),
        ("overshoot of a step, %", 100.0, |f| f.overshoot, limits.overshoot),
        ("settling of a step, s", 1.0, |f| f.settling_s, limits.settling_s),
        (activity, 100.0, |f| f.activity, limits.activity),
    ];
    let of_loop: [OfLoop; 4] = [
        ("gain may rise by, dB", |m| m.gain_db, limits.gain_db),
        ("gain may fall by, dB", |m| m.gain_reduction_db, limits.gain_db),
        ("phase margin, degrees", |m| m.phase_deg, limits.phase_deg),
        ("delay may grow by, s", |m| m.delay_s, limits.delay_s),
    ];
    let flights = of_flights.into_iter().map(|(name, unit, figure, limit)| {
        let values = |flown: &[Option<Figures>]| {
            let each = flown.iter().map(move |f| f.as_ref().map_or(f64::INFINITY, figure));
            percentile_between(each, SHARE).map(|x| unit * x)
        };
        let finite = |x: f64| x.is_finite().then_some(x);
        let [[before, ..], [after, low, high]] = flown.map(values);
        let limit = unit * limit;
        let standing = match () {
            () if after <= limit => Standing::Held,
            // Where there is no more than a few airframes, the interval is wide, and says so.
            () if low <= limit => Standing::AtLimit,
            () => Standing::Broken,
        };
        Judged {
            name,
            before: finite(before),
            after: finite(after),
            between: Some([low, high]),
            limit,
            standing,
        }
    });
    let loops = of_loop.into_iter().map(|(name, margin, limit)| {
        let [before, after] = margins.each_ref().map(|margins| margins.as_ref().and_then(margin));
        let is_held = margins[1].is_some() && after.is_none_or(|after| after >= limit);
        let standing = if is_held { Standing::Held } else { Standing::Broken };
        Judged { name, before, after, between: None, limit, standing }
    });
    flights.chain(loops).collect()
}

impl Tuned {
    /// Whether all limits are held and enough of the fresh airframes hold.
    pub fn passed(&self) -> bool {
        self.checked.value() >= HOLDING && self.broken().next().is_none()
    }

    fn broken(&self) -> impl Iterator<Item = &Judged> {
        self.judged.iter().filter(|judged| judged.standing == Standing::Broken)
    }

    /// What the fresh airframes do, such as `99.4 % of 600 fresh airframes hold 0.4 m within 2 cm`.
    fn in_short(&self, altitude_m: f64) -> String {
        let does = match self.of {
            LoopKind::Altitude => format!("hold {} m", digits(altitude_m)),
            LoopKind::Lateral => "keep their place".to_owned(),
        };
        let share = if self.checked.count == self.checked.of {
            format!("all {}", self.checked.of)
        } else {
            // Rounded down: 99.97 % are not all.
            format!("{:.1} % of {}", (1000.0 * self.checked.value()).floor() / 10.0, self.checked.of)
        };
        format!("{share} fresh airframes {does} within {} cm", digits(100.0 * self.limits.rms_m))
    }
}

impl Tuning {
    /// Whether every loop passed.
    pub fn passed(&self) -> bool {
        self.loops.iter().all(Tuned::passed)
    }

    /// The verdict, in a sentence.
    pub fn verdict(&self) -> String {
        let shares = |loops: &mut dyn Iterator<Item = &Tuned>| {
            loops.map(|tuned| tuned.in_short(self.altitude_m)).collect::<Vec<_>>().join("; ")
        };
        if self.passed() {
            return format!("All limits held; {}.", shares(&mut self.loops.iter()));
        }
        let mut short = Vec::new();
        for tuned in &self.loops {
            for judged in tuned.broken() {
                let [value, limit] = judged.apart();
                let value = if judged.after.is_some() { value } else { "lost".to_owned() };
                short.push(format!(
                    "{} loop, {}: {value}, the limit is {limit}",
                    tuned.of.name(),
                    judged.name
                ));
            }
            if tuned.checked.value() < HOLDING {
                short.push(format!("only {}, 99 % are asked for", tuned.in_short(self.altitude_m)));
            }
        }
        format!("Not good enough: {}.", short.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(activity: f64) -> Figures {
        Figures { rms_m: 0.01, overshoot: 0.1, settling_s: 3.0, activity }
    }

    fn limits() -> Limits {
        Limits {
            rms_m: 0.02,
            overshoot: 0.3,
            settling_s: 6.0,
            activity: 0.02,
            gain_db: 4.5,
            phase_deg: 35.0,
            delay_s: 0.2,
        }
    }

    fn activity_of(flown: &[Option<Figures>]) -> Judged {
        judge(LoopKind::Altitude, &limits(), [flown, flown], [None, None])[3]
    }

    #[test]
    fn a_percentile_is_at_its_limit_within_what_it_is_known_to_and_broken_beyond() {
        // Spread evenly by a tenth about a centre: the 95th percentile stands 4.5 % above it.
        let spread = |centre: f64| -> Vec<Option<Figures>> {
            (0..600).map(|i| Some(figures(centre * (0.95 + 0.1 * f64::from(i) / 600.0)))).collect()
        };
        assert_eq!(activity_of(&spread(0.019)).standing, Standing::Held);
        let at = activity_of(&spread(0.01915));
        assert_eq!(at.standing, Standing::AtLimit, "{at:?}");
        assert!(at.between.unwrap()[0] <= 2.0 && at.after.unwrap() > 2.0);
        assert_eq!(activity_of(&spread(0.0196)).standing, Standing::Broken);
        // One in twenty that does not get through is too many, however the others are.
        let lost: Vec<_> = (0..100).map(|i| (i >= 20).then(|| figures(0.01))).collect();
        assert_eq!((activity_of(&lost).standing, activity_of(&lost).after), (Standing::Broken, None));
    }

    #[test]
    fn a_loop_that_is_not_stable_holds_no_margin() {
        let flown = [Some(figures(0.01))];
        let judged = judge(LoopKind::Lateral, &limits(), [&flown, &flown], [None, None]);
        assert!(judged[4..].iter().all(|judged| judged.standing == Standing::Broken), "{judged:?}");
    }

    #[test]
    fn a_value_is_told_from_its_limit() {
        assert_eq!([told(2.0047, 2.0), told(2.11, 2.0), told(2.0, 2.0)], ["2.005", "2.11", "2"]);
        assert_eq!(told(4.499_996, 4.5), "4.499996");
    }
}

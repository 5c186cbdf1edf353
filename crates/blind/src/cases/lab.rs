use bench_rig::Rig;

use crate::physics::{
    actuator::{OutputFault, RadioFault},
    air::{Gust, Miss, Turbulence},
    body::{Body, Numbers},
    law::Law,
    outside::MissingMotor,
    timing::LoopFault,
    tracker::{Camera, TrackerFault},
};

/// One thing that departs from the nominal model.
#[derive(Debug)]
pub(crate) enum Fault {
    Law(Box<dyn Law>),
    Gust(Gust),
    Miss(Miss, MissingMotor),
    Output(OutputFault),
    Radio(RadioFault),
    Tracker(TrackerFault),
    Loop(LoopFault),
}

impl Fault {
    pub(crate) fn law(&self) -> Option<&dyn Law> {
        match self {
            Self::Law(law) => Some(law.as_ref()),
            Self::Miss(_, law) => Some(law),
            _ => None,
        }
    }

    /// Whether it shows in the spread of noise, in lost frames or in time stamps, and not in the mean of what is seen.
    pub(crate) fn is_told_by_spread(&self) -> bool {
        match self {
            Self::Loop(_) => true,
            Self::Tracker(fault) => matches!(
                fault,
                TrackerFault::Queue { .. }
                    | TrackerFault::HeldUp { .. }
                    | TrackerFault::HeavyTails { .. }
                    | TrackerFault::Wander { .. }
                    | TrackerFault::Bursts { .. }
                    | TrackerFault::Occlusions { .. }
                    | TrackerFault::Strays { .. }
                    | TrackerFault::WrongMark { .. }
            ),
            _ => false,
        }
    }

    /// Whether both can be in one case: there is one camera, one converter, one radio, one loop and one wind.
    pub(crate) fn goes_with(&self, other: &Self) -> bool {
        let laws = self.law().is_some() && other.law().is_some();
        laws || std::mem::discriminant(self) != std::mem::discriminant(other)
    }
}

/// A case as the generator flies it: this airframe's numbers, its faults, its air, its random numbers.
#[derive(Debug)]
pub(crate) struct Lab {
    pub numbers: Numbers,
    pub faults: Vec<Fault>,
    pub turbulence: Turbulence,
    /// Fraction of thrust gone after a minute of hover, without any effect.
    pub drain_per_min: f64,
    pub camera: Camera,
    /// Throttle at rest, in units of the sticks.
    pub rest: f64,
    pub seed: u64,
    pub stream: u64,
}

macro_rules! only {
    ($(#[$doc:meta])* $name:ident, $kind:ident, $what:ty) => {
        $(#[$doc])*
        pub(crate) fn $name(&self) -> Option<&$what> {
            self.faults.iter().find_map(|fault| match fault {
                Fault::$kind(found, ..) => Some(found),
                _ => None,
            })
        }
    };
}

impl Lab {
    only!(gust, Gust, Gust);
    only!(miss, Miss, Miss);
    only!(output_fault, Output, OutputFault);
    only!(radio, Radio, RadioFault);
    only!(loop_fault, Loop, LoopFault);

    /// The airframe with all of its laws.
    pub(crate) fn body(&self, trim: f64) -> Body<'_> {
        self.body_with(trim, self.numbers, |_| true)
    }

    /// The airframe with those faults' laws that `keep` names by their place, and other numbers.
    pub(crate) fn body_with(&self, trim: f64, numbers: Numbers, keep: impl Fn(usize) -> bool) -> Body<'_> {
        let kept = self.faults.iter().enumerate().filter(|(i, _)| keep(*i));
        let laws = kept.filter_map(|(_, fault)| fault.law()).collect();
        Body { numbers, trim, drain_per_min: self.drain_per_min, laws }
    }

    /// When a pin that changed at `t_s` is heard by the motors.
    pub(crate) fn heard_at(&self, t_s: f64) -> f64 {
        self.radio().map_or(t_s, |radio| radio.heard_at(t_s))
    }

    /// The rig's tracker with this case's latency and fault.
    pub(crate) fn camera(rig: &Rig, numbers: Numbers, faults: &[Fault]) -> Camera {
        let fault = faults.iter().find_map(|fault| match fault {
            Fault::Tracker(fault) => Some(fault.clone()),
            _ => None,
        });
        Camera {
            latency_s: numbers.0[Numbers::LATENCY],
            believed_latency_s: rig.tracker.latency_s.value,
            noise_m: rig.tracker.noise_m,
            resolution_m: rig.tracker.resolution_m,
            dropout_probability: rig.tracker.dropout_probability,
            fault,
        }
    }
}

//! How flights show an effect: what those who look for its traces must know beside its law.

use std::ops::{Index, IndexMut};

/// How flights show an effect. [`Signature::LAW`], [`Signature::READING`] and [`Signature::spread`] are what to start from.
pub struct Signature {
    /// In what it shows.
    pub shows: Shows,
    /// Quantities that its force (or view) depends on: another form of its law would show along them.
    pub axes: &'static [Axis],
    /// How it changes what the tracker sees, from values in the order of the spec's parameters.
    pub view: fn(&[f64], &mut View),
    /// What is read directly if it is there.
    pub reading: Option<Reading>,
    /// Numbers of the rig to which a parameter adds: number, and index of the parameter.
    pub adds_to: &'static [(RigNumber, usize)],
    /// Delays what is commanded or seen. Lags of an airframe are of any order, so two of them look alike.
    pub lag: bool,
    /// Thrust fades with the charge that is drawn, of which an unknown part was drawn before the flight.
    pub fades: bool,
    /// Values of parameters beyond which flights show another effect: key and largest value to be fitted.
    pub fitted_up_to: &'static [(&'static str, f64)],
    /// Effects that do nearly the same to ordinary flights.
    pub confounded_with: &'static [&'static str],
}

impl Signature {
    /// Of a law that moves flights.
    pub const LAW: Self = Self {
        shows: Shows::Law,
        axes: &[],
        view: |_, _| {},
        reading: None,
        adds_to: &[],
        lag: false,
        fades: false,
        fitted_up_to: &[],
        confounded_with: &[],
    };

    /// Of what shows in direct readings alone.
    pub const READING: Self = Self { shows: Shows::Reading, ..Self::LAW };

    /// Of what shows in the spread of measurements alone.
    pub const fn spread(spread: Spread) -> Self {
        Self { shows: Shows::Spread(spread), ..Self::LAW }
    }
}

/// In what flights show an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// In their expected course.
    Law,
    /// The same, in those that tilt.
    LawWhenTilted,
    /// In the spread of measurements about it.
    Spread(Spread),
    /// In readbacks, ticks and answers alone.
    Reading,
}

impl Shows {
    /// In words, after "shows in".
    pub const fn words(self) -> &'static str {
        match self {
            Self::Law => "the course of a flight",
            Self::LawWhenTilted => "the course of a flight that tilts",
            Self::Spread(_) => "the spread of measurements",
            Self::Reading => "readbacks, ticks and answers",
        }
    }
}

/// A kind of spread, with what the first values of its effect's parameters mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Wind acts through the drag: deviation, m/s, and correlation time, s.
    Turbulence,
    /// Measurements are noisy: deviation, m.
    MeasurementNoise,
    /// Frames wait: deviation, and mean, of the wait, s.
    LateFrames,
    /// Frames never arrive: share, and mean number in a row.
    LostFrames,
    /// Frames show another place: share, and deviation of the place, m.
    WrongPlaces,
}

/// What is read directly, without a model of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Pins follow their commands late: time constant, s.
    PinLag,
    /// Pins stop at an end: lowest and highest, as thrust over weight.
    PinLimit,
    /// Pins move in steps: step over the range.
    PinSteps,
    /// Pins stay behind turns of their commands: width over the range.
    PinHysteresis,
    /// Iterations, or their answers, come late: share, and delay, s.
    LateIterations,
    /// Frames are missing: share, and mean number in a row.
    LostFrames,
    /// Frames arrive off their clock: deviation, s.
    LateFrames,
    /// The latency of frames is another: by how much, s.
    Latency,
}

/// A number of the rig of which an airframe, or its tracker, may have another value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RigNumber {
    /// Mass, kg.
    Mass,
    /// Gain of the thrust, N per unit of throttle; the throttle that hovers, where the rig knows that.
    ThrustGain,
    /// Throttle at which thrust begins.
    ThrustOffset,
    /// Multiplier of the thrust on the ground.
    GroundEffectMultiplier,
    /// Height over which the ground effect fades, m.
    GroundEffectHeight,
    /// Linear drag, N s/m.
    Drag,
    /// Latency of the tracker, s.
    Latency,
    /// Altitude of the tracker's origin, m.
    Origin,
}

impl RigNumber {
    /// How many there are.
    pub const COUNT: usize = 8;
    /// All of them.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Mass,
        Self::ThrustGain,
        Self::ThrustOffset,
        Self::GroundEffectMultiplier,
        Self::GroundEffectHeight,
        Self::Drag,
        Self::Latency,
        Self::Origin,
    ];
}

/// A value for each number of a rig, in the order of [`RigNumber::ALL`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PerNumber<T>(pub [T; RigNumber::COUNT]);

impl<T> PerNumber<T> {
    /// Numbers and values.
    pub fn iter(&self) -> impl Iterator<Item = (RigNumber, &T)> {
        RigNumber::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<RigNumber> for PerNumber<T> {
    type Output = T;

    #[inline]
    fn index(&self, number: RigNumber) -> &T {
        &self.0[number as usize]
    }
}

impl<T> IndexMut<RigNumber> for PerNumber<T> {
    #[inline]
    fn index_mut(&mut self, number: RigNumber) -> &mut T {
        &mut self.0[number as usize]
    }
}

/// A quantity that is known along a flight, over which forces are looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Altitude, m.
    Altitude,
    /// Vertical speed, m/s.
    Speed,
    /// Nominal thrust out of the ground effect over nominal weight.
    ThrustToWeight,
    /// Change of that ratio against what it was of late, through a lag.
    ThrustChange,
    /// Time since the throttle first left its rest, s.
    Time,
    /// Integral of the thrust-to-weight ratio, minutes.
    Charge,
    /// Voltage of the battery, V; 0 where it was not measured.
    Voltage,
    /// Altitude as it was of late, through a lag, m.
    Past,
}

impl Axis {
    /// How many there are.
    pub const COUNT: usize = 8;
    /// All of them.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Altitude,
        Self::Speed,
        Self::ThrustToWeight,
        Self::ThrustChange,
        Self::Time,
        Self::Charge,
        Self::Voltage,
        Self::Past,
    ];
}

/// How a tracker sees altitude, `factor z + bend z^2 + offset`, and how late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Scale.
    pub factor: f64,
    /// Growth of the scale over altitude, 1/m.
    pub bend_per_m: f64,
    /// Altitude seen on the ground, m.
    pub offset_m: f64,
    /// Exposure to arrival, s.
    pub latency_s: f64,
}

impl View {
    /// Altitude as seen, m.
    #[inline]
    pub fn seen_m(&self, z_m: f64) -> f64 {
        (self.factor + self.bend_per_m * z_m) * z_m + self.offset_m
    }

    /// Its derivative.
    #[inline]
    pub fn slope(&self, z_m: f64) -> f64 {
        self.factor + 2.0 * self.bend_per_m * z_m
    }

    /// The altitude that is seen so, m.
    pub fn altitude_m(&self, seen_m: f64) -> f64 {
        let straight = (seen_m - self.offset_m) / self.factor;
        // The bend is small: one step of Newton's.
        straight - (self.seen_m(straight) - seen_m) / self.slope(straight)
    }
}

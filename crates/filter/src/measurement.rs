//! A measurement held against its prediction: how likely it is under what blurs, delays and loses frames.

use bench_statistics::FAR_SIGMAS;

use crate::{covariance::Covariance, noise::Noise};

/// How much older than it seems a measurement may be that is not the one before again, frames.
const MOST_STALE_FRAMES: i32 = 10; // numerical
/// After so many frames it is forgotten whether one was lost.
const MOST_FRAMES_BETWEEN: f64 = 1000.0; // numerical
/// Whether a reading is repeated tells something where a fresh frame would repeat it with less than this probability.
const REPEATED_BY_CHANCE: f64 = 0.03;

/// A measurement beside its prediction.
pub struct AltitudeMeasurement {
    /// What the tracker shows of a metre.
    pub factor: f64,
    pub speed_m_s: f64,
    pub timing_s: f64,
    /// It is the same as the one before.
    pub repeats: bool,
    /// That one was not near the ground, where an airframe may rest that the model has move, and how far off the prediction it is.
    pub flies: bool,
    pub from_last_m: f64,
    /// Resolution, m.
    pub step_m: f64,
    /// Between two frames, and since the measurement before, s.
    pub frame_s: f64,
    pub since_s: f64,
}

/// What a measurement says of a prediction.
#[derive(Clone, Copy)]
pub struct Scored {
    /// Negative log-likelihood.
    pub nll: f64,
    /// What there is to learn from: the innovation, of a measurement that may be older less what the airframe has moved since,
    pub residual: f64,
    /// its variance,
    pub variance: f64,
    /// and its weight (Huber's, and how probably it is of the airframe).
    pub weight: f64,
    /// How probably it is of an older frame than its own.
    pub stale: f64,
}

impl Scored {
    /// An innovation of such a variance: normal, and beyond a few sigma linear (Huber).
    #[inline]
    pub fn bounded(residual: f64, variance: f64) -> Self {
        let u2 = residual * residual / variance;
        let (nll, weight) = if u2 <= FAR_SIGMAS * FAR_SIGMAS {
            (0.5 * u2, 1.0)
        } else {
            let u = u2.sqrt();
            (FAR_SIGMAS * u - 0.5 * FAR_SIGMAS * FAR_SIGMAS, FAR_SIGMAS / u)
        };
        Self { nll: nll + 0.5 * variance.ln(), residual, variance, weight, stale: 0.0 }
    }

    /// Its probability a metre.
    fn density(&self) -> f64 {
        (-self.nll).exp() / std::f64::consts::TAU.sqrt()
    }
}

impl AltitudeMeasurement {
    /// Holds an innovation against a state's covariance, where the measurement before was of an older frame with probability `stale`.
    #[inline]
    pub fn score(&self, p: &Covariance, noise: &Noise, residual: f64, stale: f64) -> Scored {
        let blur2 = (self.factor * self.speed_m_s).powi(2) * (self.timing_s.powi(2) + noise.jitter_s.powi(2));
        let variance = self.factor * self.factor * p[0][0] + noise.measurement_m.powi(2) + blur2;
        if noise.outlier_probability > 0.0 {
            misplaced(noise, residual, variance)
        } else if noise.stale_probability > 0.0 {
            self.perhaps_stale(&Lost::of(noise), residual, variance, stale)
        } else {
            Scored::bounded(residual, variance)
        }
    }

    /// A mixture: the measurement is of the newest frame, of an older one because those after it were lost, or the one before again
    /// because all were. What it says of the airframe is that of a normal law with the mixture's mean and variance.
    fn perhaps_stale(&self, lost: &Lost, residual: f64, variance: f64, stale: f64) -> Scored {
        // Bounded as without: what no hypothesis explains is not to speak against this one.
        let newest = Scored::bounded(residual, variance);
        let since_last = (self.since_s / self.frame_s).round().clamp(1.0, MOST_FRAMES_BETWEEN) as i32;
        let same = (stale * lost.stays() + (1.0 - stale) * lost.begins) * lost.stays().powi(since_last - 1);
        let (mut older_chance, mut older, mut late_m, mut late_m2) = (0.0, 0.0, 0.0, 0.0);
        for frames in 1..since_last.min(MOST_STALE_FRAMES) {
            let moved_m = self.factor * self.speed_m_s * f64::from(frames) * self.frame_s;
            let seen_before = 1.0 - lost.after(stale, since_last - frames);
            let chance = seen_before * lost.begins * lost.stays().powi(frames - 1);
            let likely = chance * Scored::bounded(residual + moved_m, variance).density();
            older_chance += chance;
            older += likely;
            late_m += likely * moved_m;
            late_m2 += likely * moved_m * moved_m;
        }
        let fresh = (1.0 - same - older_chance).max(0.0) * newest.density();
        // The same reading again has a probability, not a density: that over the width of a step.
        let neutral = same * newest.density();
        let by_chance = self.step_m * Scored::bounded(self.from_last_m, variance).density();
        let again = match (self.repeats, self.flies || by_chance < REPEATED_BY_CHANCE) {
            (true, true) => same / self.step_m,
            (true, false) => neutral,
            (false, _) => 0.0,
        };
        // Where a fresh frame would show much the same it is no evidence whether a reading is repeated: rounding repeats them, too.
        let tells = self.flies && by_chance < REPEATED_BY_CHANCE;
        let told = fresh + older + if tells { again } else { neutral };
        let (seen, all) = ((fresh + older).max(1e-300), (fresh + older + again).max(1e-300));
        let late_m = late_m / seen;
        Scored {
            // As without, but for the constant that all others leave out.
            nll: -told.max(1e-300).ln() - 0.5 * std::f64::consts::TAU.ln(),
            residual: residual + late_m,
            variance: variance + (late_m2 / seen - late_m * late_m).max(0.0),
            // The later, the less it is learnt from: how late it is hangs on a speed that is not known exactly.
            weight: newest.weight * seen / all,
            stale: (older + again) / all,
        }
    }
}

/// A mixture: the measurement is of something else with some probability.
fn misplaced(noise: &Noise, residual: f64, variance: f64) -> Scored {
    let normal = |variance: f64| (-0.5 * residual * residual / variance).exp() / variance.sqrt();
    let near = (1.0 - noise.outlier_probability) * normal(variance);
    let far = noise.outlier_probability * normal(variance + noise.outlier_m.powi(2));
    let total = (near + far).max(1e-300);
    Scored { nll: -total.ln(), residual, variance, weight: near / total, stale: 0.0 }
}

/// How frames are lost: a Markov chain of two states, frame by frame (Gilbert, *Capacity of a Burst-Noise Channel*, Bell System
/// Technical Journal 39(5), 1960).
struct Lost {
    share: f64,
    begins: f64,
    ends: f64,
}

impl Lost {
    fn of(noise: &Noise) -> Self {
        let (share, ends) = (noise.stale_probability, noise.stale_frames.max(1.0).recip());
        Self { share, begins: (ends * share / (1.0 - share)).min(1.0), ends }
    }

    /// Probability that the frame after a lost one is lost too.
    fn stays(&self) -> f64 {
        1.0 - self.ends
    }

    /// Probability that a frame is lost, so many after one that was with probability `lost`.
    fn after(&self, lost: f64, frames: i32) -> f64 {
        self.share + (lost - self.share) * (1.0 - self.begins - self.ends).powi(frames)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of an airframe that moves by 3 cm between frames, read every third frame with a noise of 2.5 mm and a step of 1 mm.
    fn sight(repeats: bool, from_last_m: f64) -> AltitudeMeasurement {
        AltitudeMeasurement {
            factor: 1.0,
            speed_m_s: 0.9,
            timing_s: 0.0,
            repeats,
            flies: true,
            from_last_m,
            step_m: 0.001,
            frame_s: 1.0 / 30.0,
            since_s: 0.1,
        }
    }

    fn score(sight: &AltitudeMeasurement, residual_m: f64, stale: f64) -> Scored {
        let lost = Lost { share: 0.2, begins: 0.05, ends: 0.2 };
        sight.perhaps_stale(&lost, residual_m, 0.0025_f64.powi(2), stale)
    }

    #[test]
    fn a_reading_that_stands_still_in_flight_is_an_old_one_and_is_not_learnt_from() {
        let held = score(&sight(true, -0.09), -0.09, 0.1);
        assert!(held.stale > 0.99 && held.weight < 0.01, "{} {}", held.stale, held.weight);
        // Once that is known, it speaks for lost frames the more.
        let still = score(&sight(true, -0.09), -0.09, held.stale);
        assert!(still.nll < held.nll - 1.0, "{} {}", still.nll, held.nll);
        let fresh = score(&sight(false, -0.09), 0.001, held.stale);
        assert!(fresh.stale < 0.05 && fresh.weight > 0.95, "{} {}", fresh.stale, fresh.weight);
    }

    #[test]
    fn a_reading_one_frame_late_tells_where_the_airframe_was() {
        let late = score(&sight(false, -0.09), -0.03, 0.0);
        assert!(late.stale > 0.99 && late.residual.abs() < 0.001, "{} {}", late.stale, late.residual);
        assert!(late.weight > 0.3, "{}", late.weight);
    }

    #[test]
    fn a_hover_is_no_evidence_of_lost_frames_whether_it_repeats_readings_or_not() {
        for repeats in [false, true] {
            let hover = AltitudeMeasurement { speed_m_s: 0.0, ..sight(repeats, 0.0005) };
            let (with, without) = (score(&hover, 0.0005, 0.2), Scored::bounded(0.0005, 0.0025_f64.powi(2)));
            assert!((with.nll - without.nll).abs() < 1e-9, "{repeats}: {} {}", with.nll, without.nll);
        }
    }
}

//! The hypotheses: all that was fitted or read, with what speaks for each.

use bench_inference::{Problem, Regions, Search};
use bench_plant::effects::LIBRARY;
use bench_rig::HeldOut;
use serde::Serialize;

use crate::{decision::Weighable, direct::Direct, nameless::Nameless};

/// A hypothesis with what speaks for it.
pub struct Hypothesis {
    /// Library indices; none for the null.
    pub effects: Vec<usize>,
    /// The fit over its effects that the filter sees.
    pub fit: usize,
    /// Those of its effects that direct channels speak for.
    pub direct: Vec<usize>,
    /// What speaks for it by kind of evidence.
    pub grounds: Grounds,
    /// What its fit leaves, where that was looked at.
    pub regions: Option<Regions>,
    /// Whether the flights say nothing of one of its effects, which was not fitted.
    pub hidden: bool,
}

/// What speaks for a hypothesis, and what its laws leave, nats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Grounds {
    /// Gain of the filter's log-evidence over none.
    pub flight: f64,
    /// Evidence of direct channels.
    pub direct: f64,
    /// What the model's own error gains it on nominal flights of as many measurements, which is taken off.
    pub nominal: f64,
    /// What a cause without a name would gain on top of it, by kind; absent where it was not looked at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nameless: Option<Nameless>,
}

impl Hypothesis {
    /// Gain of log-evidence over none, all channels, less what the model's own error gains, nats.
    pub fn gain(&self) -> f64 {
        self.grounds.flight + self.grounds.direct - self.grounds.nominal
    }

    /// The effects' names.
    pub fn names(&self) -> Vec<&'static str> {
        self.effects.iter().map(|index| LIBRARY[*index].name).collect()
    }

    /// What the decision knows of it.
    pub fn weighable(&self) -> Weighable {
        Weighable {
            effects: self.effects.clone(),
            gain: self.gain(),
            direct: self.grounds.direct,
            nameless: self.grounds.nameless.as_ref().filter(|_| !self.hidden).map(Nameless::evidence),
            readback: self.grounds.nameless.map_or(0.0, |found| found.readback),
            slight: self.grounds.nameless.map_or(0.0, |found| found.slight),
        }
    }
}

/// All hypotheses of at most two effects that were fitted or read, none first.
pub fn hypotheses(problem: &Problem<'_>, search: &Search, direct: &Direct) -> Vec<Hypothesis> {
    let mut all: Vec<Hypothesis> = Vec::new();
    let mut add = |fit: usize, read: &[usize]| {
        let fitted = search.fits[fit].effects();
        let mut effects = fitted.clone();
        effects.extend(read.iter().filter(|effect| !fitted.contains(effect)));
        if effects.len() > 2 {
            return;
        }
        let found = |effect: &usize| {
            direct.effects.iter().find(|found| found.effect == *effect).map_or(0.0, |found| found.gain)
        };
        let names: Vec<&str> = effects.iter().map(|effect| LIBRARY[*effect].name).collect();
        // An effect that the filter sees and a direct channel too has both for it.
        let grounds = Grounds {
            flight: search.gain(fit),
            direct: effects.iter().map(found).sum(),
            nominal: nominal_gain(problem, &names),
            nameless: None,
        };
        let direct = told_by(search.fits[fit].effects().as_slice(), &effects, read, direct);
        let this = Hypothesis { effects, fit, direct, grounds, regions: None, hidden: false };
        match all.iter_mut().find(|other| same(&other.effects, &this.effects)) {
            Some(other) if this.gain() > other.gain() => *other = this,
            Some(_) => {}
            None => all.push(this),
        }
    };
    // A lag that pins were read to have moves what flies, too.
    let lag = direct.lag_of_pins.filter(|lag| search.fits.iter().any(|fit| fit.effects().contains(lag)));
    for fit in 0..search.fits.len() {
        add(fit, &[]);
        for found in &direct.effects {
            if lag != Some(found.effect) || search.fits[fit].effects().contains(&found.effect) {
                add(fit, &[found.effect]);
            }
        }
    }
    for (i, a) in direct.effects.iter().enumerate() {
        for b in &direct.effects[i + 1..] {
            let both = [a.effect, b.effect];
            if b.channel != a.channel || direct.together.is_some_and(|together| same(&together, &both)) {
                add(0, &both);
            }
        }
    }
    // Of other effects these flights say nothing, neither for nor against.
    for effect in 0..LIBRARY.len() {
        if !all.iter().any(|h| h.effects == [effect]) {
            let grounds = Grounds::default();
            let (effects, direct) = (vec![effect], Vec::new());
            all.push(Hypothesis { effects, fit: 0, direct, grounds, regions: None, hidden: true });
        }
    }
    all
}

/// Pairs of each single effect with any other that are not among the hypotheses: the flights say nothing of the second.
pub fn hidden_seconds(all: &[Hypothesis]) -> Vec<Hypothesis> {
    let mut hidden: Vec<Hypothesis> = Vec::new();
    for single in all.iter().filter(|h| h.effects.len() == 1 && !h.hidden) {
        for second in 0..LIBRARY.len() {
            let effects = [single.effects[0], second];
            let known = |h: &Hypothesis| same(&h.effects, &effects);
            if second != single.effects[0] && !all.iter().any(known) && !hidden.iter().any(known) {
                let Hypothesis { fit, ref direct, grounds, .. } = *single;
                let grounds = Grounds { nameless: None, ..grounds };
                hidden.push(Hypothesis {
                    effects: effects.to_vec(),
                    fit,
                    direct: direct.clone(),
                    grounds,
                    regions: None,
                    hidden: true,
                });
            }
        }
    }
    hidden
}

/// Those of the effects whose size a direct channel tells. What a readback shows of a pin, a flight tells but once more; how long a
/// lag is that was read at some time on its way, the flight alone.
fn told_by(fitted: &[usize], effects: &[usize], read: &[usize], direct: &Direct) -> Vec<usize> {
    let read_back = |effect: usize| {
        direct.effects.iter().any(|found| found.effect == effect && found.channel == "readback")
    };
    let flown = |effect: usize| direct.lag_of_pins == Some(effect) && fitted.contains(&effect);
    let told = |effect: &usize| (read.contains(effect) || read_back(*effect)) && !flown(*effect);
    effects.iter().copied().filter(told).collect()
}

/// What nominal flights of as many measurements would gain a hypothesis of these names by the model's own error, as the rig tells it:
/// of a pair at least what one of it does.
pub fn nominal_gain(problem: &Problem<'_>, names: &[&str]) -> f64 {
    let holds = |told: &HeldOut| told.hypothesis.split('+').all(|name| names.contains(&name));
    let told = problem.rig.held_out.iter().filter(|told| holds(told)).map(|told| told.nats_per_measurement);
    let most = told.fold(0.0, f64::max);
    // Most rigs tell none, and counting goes through all measurements.
    if most > 0.0 { most * problem.counted() as f64 } else { 0.0 }
}

/// Whether two hypotheses are of the same effects, in whatever order.
pub fn same(a: &[usize], b: &[usize]) -> bool {
    a.len() == b.len() && a.iter().all(|x| b.contains(x))
}

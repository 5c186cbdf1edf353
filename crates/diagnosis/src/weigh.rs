//! How hypotheses are weighed against one another: evidence of filter and direct channels, forms, and what is left.

use bench_filter::{is_random, spread};
use bench_inference::{Fit, MANY_FLIGHTS, Problem, Regions, Search, Waves, own_axes, pulses, regions, waves};
use bench_plant::effects::{LIBRARY, Spread};
use bench_rig::HeldOut;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    calibration::{Calibration, Telling, Told},
    diagnose::Verdict,
    direct::{Direct, direct},
};

/// Laws of another form leave some structure even where their cause is named rightly: so many nats are forgiven before a
/// gap counts as unexplained, and this share of what the winner's laws gain.
const FORGIVEN_NATS: f64 = 7.0;
const FORGIVEN_SHARE: f64 = 0.2;
/// The same of offsets of the tracker, of a drift from flight to flight and of a play, which laws of another form look less like.
const FORGIVEN_OFFSETS_SHARE: f64 = 0.1;
/// The same, in any place, of what noise gains: it has no structure of which another form might leave some.
const FORGIVEN_OF_NOISE_SHARE: f64 = 0.03;
/// Forgiven where nothing is named: flights without an effect leave next to nothing,
const FORGIVEN_NONE_NATS: f64 = 3.5;
/// but for what numbers at the edge of their tolerances leave, which looks like an offset of the tracker or like the altitude of
/// late, and for a drift from flight to flight or a play of the thrust, which are of one number each.
const FORGIVEN_NONE_OFFSETS_NATS: f64 = 6.5;
const FORGIVEN_NONE_PAST_NATS: f64 = 7.5;
const FORGIVEN_NONE_NUMBER_NATS: f64 = 4.0;
/// unless their noise was seen to differ from flight to flight: what is not the model's noise differs with it.
const FORGIVEN_NONE_UNEVEN_NATS: f64 = 7.0;
/// Forgiven of pushes that come now and then: flights whose noise was seen to differ reach it, and laws of another form,
const FORGIVEN_PULSES_NATS: f64 = 18.0;
/// flights of even noise without an effect do not come near.
const FORGIVEN_NONE_PULSES_NATS: f64 = 4.0;
/// Forgiven of numbers and forms that are odd.
const FORGIVEN_ODD_NATS: f64 = 10.0;
/// What a second effect must gain, nats and share of what the first gains alone, because the first's law may be of another
/// form: a law on top of a law,
const SECOND_LAW: (f64, f64) = (6.0, 0.04);
/// or the same nats and so many times what the first is seen to leave along its own quantities, where that is less;
const FORM_SEEN: f64 = 2.0;
/// so many nats more for a second along the same quantities, which may itself be another form of the first;
const ALONG_THE_SAME_NATS: f64 = 3.0;
/// noise on top of a law, which takes in whatever the law leaves,
const SECOND_NOISE: (f64, f64) = (8.0, 0.05);
/// readings that stand still or lie far off on top of a law,
const SECOND_READINGS: (f64, f64) = (20.0, 0.1);
/// a law on top of noise, whose size the law hardly bends,
const LAW_ON_NOISE: (f64, f64) = (4.0, 0.0005);
/// or on top of frames that are lost, of whose ages only the most probable are learnt from,
const LAW_ON_LOST: (f64, f64) = (4.0, 0.02);
/// a law on top of gusts, which are never quite the model's,
const LAW_ON_GUSTS: (f64, f64) = (6.0, 0.2);
/// two kinds of noise, which spread measurements each in its own way,
const NOISE_ON_NOISE: (f64, f64) = (8.0, 0.001);
/// but for those that make measurements late or strange, of whose spread each takes in what the other's form leaves, the more so
const ODD_MEASUREMENTS: (f64, f64) = (8.0, 0.03);
/// where most of them are lost, whose ages are known the least,
const ODD_AMONG_LOST: (f64, f64) = (8.0, 0.08);
/// and one beside a channel that was read wrongly by a law of another form, when the flight is fed with that.
const SECOND_BESIDE_CHANNEL_NATS: f64 = 3.0;
/// Less than this, nats, in any place that is looked at, is nothing that calls for another cause.
const NOTHING_LEFT_NATS: f64 = 2.0;
/// In doubt, evidence counts so many times less.
const DOUBTFUL: f64 = 10.0;
/// Hypotheses whose forms are looked at: those that others cannot overtake by form are left out.
const FORMS_WEIGHED: usize = 6;
const SINGLE_FORMS_WEIGHED: usize = 5;
/// A form may add so many nats and this share of what its effect gains itself, and such a share of what is seen along its
/// quantities.
const FORM_NATS: f64 = 3.0;
const FORM_OF_GAIN: f64 = 0.25;
const FORM_BELIEVED: f64 = 0.7;
/// So much of its gain may lie along an effect's own quantities without being called unknown.
const FORM_LEFT_OF_GAIN: f64 = 0.05;
/// A law that only fades is of few forms, and these are fitted: it leaves next to nothing along its own quantities (nothing in
/// fifteen tuning cases of three simulators), nats and share of its gain.
const FORGIVEN_OF_FADING: (f64, f64) = (3.5, 0.02);

/// The hypothesis that no effect of the library explains the gap.
pub const UNKNOWN: &str = "unknown";

/// A hypothesis with what speaks for it.
pub struct Hypothesis {
    /// Library indices; none for the null.
    pub effects: Vec<usize>,
    /// The fit over its effects that the filter sees.
    pub fit: usize,
    /// Those of its effects that direct channels speak for.
    pub direct: Vec<usize>,
    /// Gain of log-evidence over none, all channels, and what another form of its laws would add.
    pub gain: f64,
    /// What its fit leaves, where that was looked at.
    pub regions: Option<Regions>,
    /// What speaks for it by kind of evidence.
    pub grounds: Grounds,
    /// What a second effect must gain before it counts.
    forgiven: f64,
    /// What the model's own error gains it in so many measurements.
    nominal: f64,
}

impl Hypothesis {
    /// What of its gain counts, nats.
    pub fn counted(&self) -> f64 {
        self.gain - self.forgiven - self.nominal
    }

    /// The effects' names.
    pub fn names(&self) -> Vec<&'static str> {
        self.effects.iter().map(|index| LIBRARY[*index].name).collect()
    }
}

/// What speaks for a hypothesis, and what its laws leave, nats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Grounds {
    /// Gain of the filter's log-evidence over none.
    pub flight: f64,
    /// Evidence of direct channels.
    pub direct: f64,
    /// Of two effects, what the better one gains alone.
    pub first_alone: f64,
    /// What a free acceleration along the effects' own quantities would add; absent where it was not looked at, as the
    /// following.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub form: Option<f64>,
    /// The same along all quantities.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub structure: Option<f64>,
    /// The same of an offset of the tracker.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracker: Option<f64>,
}

/// All hypotheses, most probable first, and the one that none of them is true.
pub struct Weighed {
    /// The hypotheses.
    pub hypotheses: Vec<Hypothesis>,
    /// Their probabilities.
    pub probabilities: Vec<f64>,
    /// Gain of the hypothesis that no known effect explains the gap.
    pub unknown_gain: f64,
    /// Its probability.
    pub unknown: f64,
    /// Probability of `none` before it was told, where it is.
    pub none: Option<f64>,
    /// What the re-fitted rig leaves.
    pub on_null: Regions,
    /// The same that swings.
    pub waves_on_null: Waves,
    /// What swings on top of the most probable hypothesis that names its effects.
    pub waves_on_best: Waves,
    /// Evidence of thrust that is missing for moments on top of it, nats.
    pub pulses: f64,
}

impl Weighed {
    /// Weighs all fits and direct findings.
    pub fn of(problem: &Problem<'_>, search: &Search, direct: &Direct, calibration: &Calibration) -> Self {
        let on_null = regions(problem, &search.fits[0]);
        let crowd = crowd(problem);
        let mut hypotheses = hypotheses(problem, search, direct, crowd);
        let weight =
            |h: &Hypothesis| calibration.ln_prior(&h.effects) + h.counted() / calibration.temperature;
        let by_weight = |a: &Hypothesis, b: &Hypothesis| weight(b).total_cmp(&weight(a));
        hypotheses.sort_by(by_weight);
        weigh_forms(problem, search, &on_null, &mut hypotheses);
        forgive_forms_seen(search, &mut hypotheses, crowd);
        hypotheses.sort_by(by_weight);
        // Pairs that this brought to the front.
        weigh_forms(problem, search, &on_null, &mut hypotheses);
        hypotheses.sort_by(by_weight);

        let best = &hypotheses[0];
        let waves_on_null = waves(problem, &search.fits[0]);
        let waves_on_best =
            if best.fit == 0 { waves_on_null.clone() } else { waves(problem, &search.fits[best.fit]) };
        let pulses = pulses(problem, &search.fits[best.fit]);
        let waves = [waves_on_null.highest().1, waves_on_best.highest().1];
        let rest = Rest::of(best, &search.fits[best.fit], &on_null, waves, direct);
        let forgiven = Forgiven::of(best, &hypotheses, uneven(problem), crowd);
        let mut left = rest.unexplained(&forgiven);
        let beyond = pulses - forgiven.pulses;
        if beyond > 0.0 {
            left = left.max(beyond);
        }
        // An unknown law need not bend what is known, nor be two.
        let odd = if best.effects.is_empty() { 0.0 } else { search.fits[best.fit].odd_nats() };
        if odd > 0.0 {
            left = left.max(counted(odd, crowd * FORGIVEN_ODD_NATS + best.forgiven, forgiven.clean));
        }
        let only_gusts = only_gusts(&search.fits[best.fit]);
        if only_gusts {
            // Pushes one way, in ordinary air, may be all that there is.
            left = left.max(self::pulses(problem, &search.fits[0]) - best.gain);
        }
        // Wind never leaves anything: it takes in what it does not explain.
        let nothing_left = !only_gusts && rest.most().max(pulses).max(odd) < NOTHING_LEFT_NATS;
        let unknown_gain = best.gain + left;
        let nominal_unknown = nominal_gain(problem, &[UNKNOWN]);
        let posterior = |temperature: f64| {
            let at = |prior: f64, gain: f64| prior + gain / temperature;
            let mut weights: Vec<f64> =
                hypotheses.iter().map(|h| at(calibration.ln_prior(&h.effects), h.counted())).collect();
            weights.push(at(calibration.ln_prior_unknown, unknown_gain - nominal_unknown));
            let highest = weights.iter().copied().fold(f64::MIN, f64::max);
            let total: f64 = weights.iter().map(|w| (w - highest).exp()).sum();
            weights.into_iter().map(|w| (w - highest).exp() / total).collect::<Vec<f64>>()
        };
        let doubt = calibration.doubt;
        let doubted = posterior(DOUBTFUL * calibration.temperature);
        let mut probabilities: Vec<f64> = posterior(calibration.temperature)
            .into_iter()
            .zip(doubted)
            .map(|(p, q)| (1.0 - doubt) * p + doubt * q)
            .collect();
        let none = hypotheses.iter().position(|h| h.effects.is_empty() && !uneven(problem));
        if let Some(none) = none {
            let nominal = calibration.nominal(probabilities[none]);
            give(&mut probabilities, none, nominal);
            settle_channels(&hypotheses, &mut probabilities, calibration);
        }
        let mut unknown = probabilities.pop().unwrap_or(0.0);
        let mut none_before = None;
        hide_seconds(&mut hypotheses, &mut probabilities, calibration.hidden_second);
        if let Some(none) = none {
            unknown += calibration.hidden_as_unknown() * probabilities[none];
            hide_firsts(&mut hypotheses, &mut probabilities, none, calibration);
            probabilities.push(unknown);
            none_before = Some(probabilities[none]);
            tell(&mut probabilities, none, calibration.told.none);
            unknown = probabilities.pop().unwrap_or(0.0);
            // Where nothing is left that is unexplained, what is not known is whether there is anything.
            if unknown_gain <= 0.0 && probabilities.iter().all(|probability| *probability < unknown) {
                std::mem::swap(&mut unknown, &mut probabilities[none]);
            }
        }
        // Nor is there another cause to suspect where the best one leaves nothing at all.
        let likeliest =
            (0..probabilities.len()).max_by(|i, j| probabilities[*i].total_cmp(&probabilities[*j]));
        if let Some(likeliest) = likeliest.filter(|i| nothing_left && probabilities[*i] < unknown) {
            std::mem::swap(&mut unknown, &mut probabilities[likeliest]);
        }
        // Last, how sure it is of effects that lead; `none` was told above.
        if let Some(leading) = leading(&probabilities, unknown) {
            let telling = calibration.telling(hypotheses[leading].effects.len());
            if telling != Telling::AS_IT_IS {
                probabilities.push(unknown);
                tell(&mut probabilities, leading, telling);
                unknown = probabilities.pop().unwrap_or(0.0);
            }
        }
        Self {
            hypotheses,
            probabilities,
            unknown_gain,
            unknown,
            none: none_before,
            on_null,
            waves_on_null,
            waves_on_best,
            pulses,
        }
    }

    /// What of the gain of each hypothesis counts, `unknown` among them, nats.
    pub fn counted(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        let named = self.hypotheses.iter().filter(|h| !h.effects.is_empty());
        named.map(|h| (h.names().join("+"), h.counted())).chain([(UNKNOWN.to_owned(), self.unknown_gain)])
    }

    /// What is told of it.
    pub fn told(&self) -> Told {
        let leading = leading(&self.probabilities, self.unknown);
        let effects = leading.map_or_else(Vec::new, |i| self.hypotheses[i].names());
        let verdict = Verdict::of(leading.map(|i| self.hypotheses[i].effects.as_slice()));
        let probability = leading.map_or(self.unknown, |i| self.probabilities[i]);
        Told { verdict, effects, probability, none: self.none }
    }
}

/// The most probable hypothesis, the first of equals; none where `unknown` is more so.
fn leading(probabilities: &[f64], unknown: f64) -> Option<usize> {
    let likeliest = (0..probabilities.len()).min_by(|i, j| probabilities[*j].total_cmp(&probabilities[*i]));
    likeliest.filter(|i| probabilities[*i] >= unknown)
}

/// By how much the weight of `none` must be moved, as a logarithm, for the best hypothesis that names or suspects something
/// not to outweigh it: for flights known to be nominal, how near a false alarm was.
pub fn alarm_margin(problem: &Problem<'_>, calibration: &Calibration) -> f64 {
    let search = Search::of(problem);
    // What counts for an alarm, not what is told.
    let calibration = &calibration.untold();
    let weighed = Weighed::of(problem, &search, &direct(problem.tracks, problem.rig), calibration);
    let told = || weighed.hypotheses.iter().zip(&weighed.probabilities);
    let none = told().find(|(h, _)| h.effects.is_empty()).map_or(0.0, |(_, probability)| *probability);
    // What is hidden moves with `none`, and is no part of what outweighs it.
    let (power, nominal) = if uneven(problem) {
        (1.0, 0.0)
    } else {
        (calibration.none_power, none / (1.0 - calibration.hidden_first))
    };
    let margin = |probability: f64, share: f64| {
        let along = share * nominal;
        (probability - along).max(1e-300).ln() - (none - along).max(1e-300).ln()
    };
    let share = |h: &Hypothesis| if h.effects.len() == 1 { calibration.hidden_as_single() } else { 0.0 };
    told()
        .filter(|(h, _)| !h.effects.is_empty())
        .map(|(h, probability)| margin(*probability, share(h)))
        .fold(margin(weighed.unknown, calibration.hidden_as_unknown()), f64::max)
        / power
}

/// Whether flights of this rig were seen to differ in their noise: then what speaks against the nominal model is not exact either.
fn uneven(problem: &Problem<'_>) -> bool {
    problem.rig.disturbance.noise_spread_ln.is_some()
}

/// Singles less probable have no seconds worth telling.
const LEAST_PROBABLE: f64 = 1e-3;

/// Gives one hypothesis a probability, and the rest to all else as it was.
fn give(probabilities: &mut [f64], to: usize, given: f64) {
    let rest = (1.0 - given) / (1.0 - probabilities[to]).max(1e-12);
    for probability in &mut *probabilities {
        *probability *= rest;
    }
    probabilities[to] = given;
}

/// Tells the odds of one hypothesis against all else.
fn tell(probabilities: &mut [f64], of: usize, telling: Telling) {
    let rivals = probabilities.iter().enumerate().filter(|(i, _)| *i != of);
    let rival = rivals.map(|(_, probability)| *probability).fold(0.0, f64::max);
    let told = telling.apply(probabilities[of], rival);
    give(probabilities, of, told);
}

/// Where a channel is read directly, the flight beside it is nominal or not: evidence counts for or against that as it does for
/// `none`, and many seconds that gain nothing do not outweigh it together.
fn settle_channels(hypotheses: &[Hypothesis], probabilities: &mut [f64], calibration: &Calibration) {
    for (i, read) in hypotheses.iter().enumerate() {
        let &[effect] = read.effects.as_slice() else { continue };
        if read.fit != 0 {
            continue;
        }
        let pairs: Vec<usize> =
            (0..hypotheses.len()).filter(|j| *j != i && hypotheses[*j].effects.contains(&effect)).collect();
        let in_pairs: f64 = pairs.iter().map(|j| probabilities[*j]).sum();
        let family = probabilities[i] + in_pairs;
        if in_pairs > 0.0 {
            probabilities[i] = family * calibration.nominal(probabilities[i] / family);
            for j in pairs {
                probabilities[j] *= (family - probabilities[i]) / in_pairs;
            }
        }
    }
}

/// Gives a share of each single effect's probability to its pairs with every other: seconds that are too small to be seen.
fn hide_seconds(hypotheses: &mut Vec<Hypothesis>, probabilities: &mut Vec<f64>, share: f64) {
    for i in 0..hypotheses.len() {
        let &[first] = hypotheses[i].effects.as_slice() else { continue };
        if probabilities[i] < LEAST_PROBABLE {
            continue;
        }
        let each = share * probabilities[i] / (LIBRARY.len() - 1) as f64;
        probabilities[i] *= 1.0 - share;
        for second in (0..LIBRARY.len()).filter(|second| *second != first) {
            hide(hypotheses, probabilities, i, second, each);
        }
    }
}

/// Gives a share of the probability of `none` to the single effects, those that are too small to be seen, and takes from it what
/// of them is `unknown`'s.
fn hide_firsts(
    hypotheses: &mut Vec<Hypothesis>,
    probabilities: &mut Vec<f64>,
    none: usize,
    calibration: &Calibration,
) {
    let nominal = probabilities[none];
    probabilities[none] -= calibration.hidden_first * nominal;
    for first in 0..LIBRARY.len() {
        hide(hypotheses, probabilities, none, first, calibration.hidden_as_single() * nominal);
    }
}

/// Adds to the probability of a hypothesis and an effect beside it that is too small to be seen.
fn hide(
    hypotheses: &mut Vec<Hypothesis>,
    probabilities: &mut Vec<f64>,
    beside: usize,
    effect: usize,
    probability: f64,
) {
    let Hypothesis { ref effects, fit, ref direct, gain, grounds, .. } = hypotheses[beside];
    let effects = [effects.as_slice(), &[effect]].concat();
    if let Some(at) = hypotheses.iter().position(|h| same(&h.effects, &effects)) {
        probabilities[at] += probability;
        return;
    }
    let direct = direct.clone();
    hypotheses.push(Hypothesis {
        effects,
        fit,
        direct,
        gain,
        regions: None,
        grounds,
        forgiven: 0.0,
        nominal: 0.0,
    });
    probabilities.push(probability);
}

/// All hypotheses of at most two effects that were fitted or read.
fn hypotheses(problem: &Problem<'_>, search: &Search, direct: &Direct, crowd: f64) -> Vec<Hypothesis> {
    let mut all: Vec<Hypothesis> = Vec::new();
    let mut add = |fit: usize, read: &[usize]| {
        let fitted = search.fits[fit].effects();
        let mut effects = fitted.clone();
        for effect in read {
            if !effects.contains(effect) {
                effects.push(*effect);
            }
        }
        if effects.len() > 2 {
            return;
        }
        let found = |effect: &usize| {
            direct.effects.iter().find(|found| found.effect == *effect).map_or(0.0, |found| found.gain)
        };
        // An effect that the filter sees and a direct channel too has both for it.
        let grounds = Grounds {
            flight: search.gain(fit),
            direct: effects.iter().map(found).sum(),
            first_alone: if effects.len() == 2 { search.alone(&effects) } else { 0.0 },
            ..Grounds::default()
        };
        let gain = grounds.flight + grounds.direct;
        let forgiven = forgiven(search, fit, &effects, crowd);
        if all
            .iter()
            .any(|other| same(&other.effects, &effects) && other.gain - other.forgiven >= gain - forgiven)
        {
            return;
        }
        all.retain(|other| !same(&other.effects, &effects));
        // What a readback shows of a pin, a flight tells but once more; how long a lag is that was read at some time on its way,
        // the flight alone.
        let read_back = |effect: usize| {
            direct.effects.iter().any(|found| found.effect == effect && found.channel == "readback")
        };
        let flown = |effect: usize| direct.lag_of_pins == Some(effect) && fitted.contains(&effect);
        let told_by = |effect: &usize| (read.contains(effect) || read_back(*effect)) && !flown(*effect);
        let read_directly = effects.iter().copied().filter(told_by).collect();
        let names: Vec<&str> = effects.iter().map(|effect| LIBRARY[*effect].name).collect();
        let nominal = nominal_gain(problem, &names);
        all.push(Hypothesis {
            effects,
            fit,
            direct: read_directly,
            gain,
            regions: None,
            grounds,
            forgiven,
            nominal,
        });
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
    all
}

/// What nominal flights of as many measurements would gain a hypothesis of these names by the model's own error, as the rig tells it:
/// of a pair at least what one of it does.
fn nominal_gain(problem: &Problem<'_>, names: &[&str]) -> f64 {
    let holds = |told: &HeldOut| told.hypothesis.split('+').all(|name| names.contains(&name));
    let told = problem.rig.held_out.iter().filter(|told| holds(told)).map(|told| told.nats_per_measurement);
    let most = told.fold(0.0, f64::max);
    // Most rigs tell none, and counting goes through all measurements.
    if most > 0.0 { most * problem.counted() as f64 } else { 0.0 }
}

/// How often there are many flights: what each leaves, however little, they leave together, and so much more is forgiven.
fn crowd(problem: &Problem<'_>) -> f64 {
    (problem.tracks.len() as f64 / MANY_FLIGHTS as f64).max(1.0)
}

/// What a second effect must gain before it counts.
fn forgiven(search: &Search, fit: usize, effects: &[usize], crowd: f64) -> f64 {
    let &[a, b] = effects else { return 0.0 };
    match search.fits[fit].point.effects.len() {
        0 => return 0.0,
        1 => return crowd * SECOND_BESIDE_CHANNEL_NATS,
        _ => {}
    }
    let first = search.alone(effects);
    let (noise, law) = if is_random(a) { (a, b) } else { (b, a) };
    let (nats, share) = if !is_random(noise) {
        SECOND_LAW
    } else if is_random(law) {
        let odd = effects.iter().all(|effect| {
            matches!(spread(*effect), Some(Spread::LateFrames | Spread::LostFrames | Spread::WrongPlaces))
        });
        let lost =
            |effect: &usize| spread(*effect) == Some(Spread::LostFrames) && search.alone(&[*effect]) >= first;
        match (odd, effects.iter().any(lost)) {
            (true, true) => ODD_AMONG_LOST,
            (true, false) => ODD_MEASUREMENTS,
            (false, _) => NOISE_ON_NOISE,
        }
    } else if search.alone(&[noise]) >= search.alone(&[law]) {
        match spread(noise) {
            Some(Spread::Turbulence) => LAW_ON_GUSTS,
            Some(Spread::LostFrames) => LAW_ON_LOST,
            _ => LAW_ON_NOISE,
        }
    } else if matches!(spread(noise), Some(Spread::LostFrames | Spread::WrongPlaces)) {
        SECOND_READINGS
    } else {
        SECOND_NOISE
    };
    crowd * nats + share * first
}

/// Whether two hypotheses are of the same effects, in whatever order.
pub(crate) fn same(a: &[usize], b: &[usize]) -> bool {
    a.len() == b.len() && a.iter().all(|x| b.contains(x))
}

/// Adds to the leading hypotheses what their laws would gain in another form.
fn weigh_forms(problem: &Problem<'_>, search: &Search, on_null: &Regions, hypotheses: &mut [Hypothesis]) {
    let mut singles = 0;
    let leading: Vec<usize> = (0..hypotheses.len())
        .filter(|i| {
            let single = hypotheses[*i].effects.len() == 1;
            singles += usize::from(single);
            let leads = *i < FORMS_WEIGHED || single && singles <= SINGLE_FORMS_WEIGHED;
            leads && hypotheses[*i].regions.is_none()
        })
        .collect();
    let looked: Vec<Regions> = leading
        .par_iter()
        .map(|i| match hypotheses[*i].fit {
            0 => on_null.clone(),
            fit => regions(problem, &search.fits[fit]),
        })
        .collect();
    for (i, found) in leading.into_iter().zip(looked) {
        let h = &mut hypotheses[i];
        h.gain += FORM_BELIEVED * found.form.min(FORM_NATS + FORM_OF_GAIN * h.gain.max(0.0));
        h.grounds.form = Some(found.form);
        h.grounds.structure = Some(found.ceiling);
        h.grounds.tracker = Some(found.offset());
        h.regions = Some(found);
    }
}

/// Of two laws, the second need not gain what another form of the first might, where the first alone is seen to leave less
/// along its own quantities.
fn forgive_forms_seen(search: &Search, hypotheses: &mut [Hypothesis], crowd: f64) {
    let seen: Vec<(usize, f64)> = hypotheses
        .iter()
        .filter_map(|h| Some((*h.effects.first()?, h.grounds.form?)).filter(|_| h.effects.len() == 1))
        .collect();
    for h in hypotheses {
        let fitted = &search.fits[h.fit].point.effects;
        let &[(a, _), (b, _)] = fitted.as_slice() else { continue };
        if is_random(a) || is_random(b) {
            continue;
        }
        let (first, second) = if search.alone(&[a]) >= search.alone(&[b]) { (a, b) } else { (b, a) };
        let along = own_axes(first).iter().any(|axis| own_axes(second).contains(axis));
        let same_nats = if along { ALONG_THE_SAME_NATS } else { 0.0 };
        if let Some((_, form)) = seen.iter().find(|(effect, _)| *effect == first) {
            h.forgiven = h.forgiven.min(crowd * (SECOND_LAW.0 + same_nats) + FORM_SEEN * form);
        }
    }
}

/// Whether a fit names gusts and nothing else that the filter sees.
fn only_gusts(fit: &Fit) -> bool {
    matches!(fit.effects().as_slice(), &[effect] if spread(effect) == Some(Spread::Turbulence))
}

/// What counts for nothing of what a hypothesis leaves, nats.
struct Forgiven {
    /// Of structure and of swings.
    moment: f64,
    /// What it counts that nothing is left of them.
    clean: f64,
    /// Of what was of late.
    past: f64,
    /// Of an offset of the tracker.
    offset: f64,
    /// Of a difference from flight to flight, and of a play.
    number: f64,
    /// Of what a law that only fades leaves along its own quantities.
    fading: f64,
    /// Of pushes that come now and then.
    pulses: f64,
}

impl Forgiven {
    fn of(best: &Hypothesis, all: &[Hypothesis], uneven: bool, crowd: f64) -> Self {
        if best.effects.is_empty() {
            return if uneven {
                let nats = crowd * FORGIVEN_NONE_UNEVEN_NATS;
                Self {
                    moment: nats,
                    clean: nats,
                    past: nats,
                    offset: nats,
                    number: nats,
                    fading: 0.0,
                    pulses: crowd * FORGIVEN_PULSES_NATS,
                }
            } else {
                Self {
                    moment: crowd * FORGIVEN_NONE_NATS,
                    clean: crowd * FORGIVEN_NONE_NATS,
                    past: crowd * FORGIVEN_NONE_PAST_NATS,
                    offset: crowd * FORGIVEN_NONE_OFFSETS_NATS,
                    number: crowd * FORGIVEN_NONE_NUMBER_NATS,
                    fading: 0.0,
                    pulses: crowd * FORGIVEN_NONE_PULSES_NATS,
                }
            };
        }
        let gain = best.gain.max(0.0);
        let (noises, laws): (Vec<usize>, Vec<usize>) =
            best.effects.iter().partition(|effect| is_random(**effect));
        // Noise that is read directly leaves in flights what they have without it.
        let alone = |effects: &[usize]| {
            all.iter()
                .filter(|h| h.effects == effects)
                .map(|h| h.grounds.flight)
                .fold(0.0, f64::max)
                .min(gain)
        };
        let of_noise = if laws.is_empty() { best.grounds.flight.clamp(0.0, gain) } else { alone(&noises) };
        let of_gain = |share: f64| share * (gain - of_noise) + share.min(FORGIVEN_OF_NOISE_SHARE) * of_noise;
        // A law that is smooth over what flights see of it: less is forgiven of what lies elsewhere, too.
        let smooth = !laws.is_empty() && laws.iter().all(|effect| LIBRARY[*effect].signature.smooth);
        let wind: Vec<usize> =
            noises.iter().copied().filter(|effect| spread(*effect) == Some(Spread::Turbulence)).collect();
        let of_wind = if wind.is_empty() { 0.0 } else { alone(&wind) };
        let nats = crowd * FORGIVEN_NATS;
        let share = if smooth { FORM_LEFT_OF_GAIN } else { FORGIVEN_SHARE };
        Self {
            moment: nats + of_gain(share),
            clean: nats + share * gain,
            past: nats + of_gain(FORGIVEN_SHARE),
            offset: nats + of_gain(FORGIVEN_OFFSETS_SHARE),
            number: nats + of_gain(FORGIVEN_OFFSETS_SHARE),
            fading: crowd * FORGIVEN_OF_FADING.0 + FORGIVEN_OF_FADING.1 * gain,
            // A law of another form leaves some too, and measurements that are wrong or old; wind does not.
            pulses: crowd * FORGIVEN_PULSES_NATS + FORGIVEN_SHARE * (gain - of_wind),
        }
    }
}

/// What is left beyond what is forgiven. Less than that counts against another cause in proportion, nothing at all as `clean`.
fn counted(left: f64, forgiven: f64, clean: f64) -> f64 {
    let beyond = left - forgiven;
    if beyond < 0.0 { beyond * (clean / forgiven).max(1.0) } else { beyond }
}

/// What no known law explains on top of a hypothesis, nats.
struct Rest {
    /// A free acceleration, what is another form of the hypothesis' laws left out.
    structure: f64,
    /// An acceleration that swings.
    wave: f64,
    /// An acceleration by what was of late.
    past: f64,
    /// An offset of the tracker.
    offset: f64,
    /// What differs from flight to flight.
    drift: f64,
    /// A play of the thrust.
    play: f64,
    /// What lies along the quantities of a law that only fades.
    fading: f64,
    /// Readbacks.
    pins: f64,
}

impl Rest {
    fn of(
        best: &Hypothesis,
        fit: &Fit,
        on_null: &Regions,
        [wave_on_null, wave]: [f64; 2],
        direct: &Direct,
    ) -> Self {
        let on_best = best.regions.as_ref().unwrap_or(on_null);
        let gain = best.gain.max(0.0);
        let mut rest = Self {
            structure: on_best.ceiling - on_best.form.min(FORM_LEFT_OF_GAIN * gain),
            wave,
            past: on_best.past,
            offset: on_best.offset(),
            drift: on_best.drift,
            play: on_best.play,
            fading: on_best.fading,
            pins: direct.unexplained_pins,
        };
        if only_gusts(fit) {
            // Wind has no structure: what a law would have explained, no gust does.
            rest.structure = rest.structure.max(on_null.ceiling);
            rest.past = rest.past.max(on_null.past);
            rest.offset = rest.offset.max(on_null.offset());
            rest.drift = rest.drift.max(on_null.drift);
            rest.play = rest.play.max(on_null.play);
            rest.wave = rest.wave.max(wave_on_null - 0.5 * gain);
        }
        rest
    }

    /// The most of it in any one place.
    fn most(&self) -> f64 {
        [self.structure, self.wave, self.past, self.offset, self.drift, self.play, self.fading, self.pins]
            .into_iter()
            .fold(0.0, f64::max)
    }

    /// All of it beyond what is forgiven; below zero where less is left.
    fn unexplained(&self, forgiven: &Forgiven) -> f64 {
        let left = self.structure.max(self.wave).max(0.7 * (self.structure + self.wave));
        let mut flight = counted(left, forgiven.moment, forgiven.clean);
        let beyond = [
            self.past - forgiven.past,
            self.offset - forgiven.offset,
            self.drift.max(self.play) - forgiven.number,
            self.fading - forgiven.fading,
        ];
        let beyond = beyond.into_iter().fold(0.0, f64::max);
        if beyond > 0.0 {
            flight = flight.max(beyond);
        }
        if self.pins > 0.0 { flight.max(0.0) + self.pins } else { flight }
    }
}

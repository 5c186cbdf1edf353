//! A test: one combination of what a case lists.

use std::{collections::BTreeSet, fmt};

use crate::{Case, Suite};

/// How a test is flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// In the virtual lab, with simulated positions.
    Sim,
    /// In the virtual lab, by rendered frames.
    Frames,
    /// Through a real board, the airframe simulated.
    Loopback,
    /// The real airframe.
    Transmitter,
}

impl Mode {
    /// All with their names in files.
    pub const CHOICES: [(&'static str, Self); 4] = [
        ("sim", Self::Sim),
        ("frames", Self::Frames),
        ("loopback", Self::Loopback),
        ("transmitter", Self::Transmitter),
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        Self::CHOICES.iter().find(|(_, mode)| *mode == self).map_or("", |(name, _)| name)
    }

    /// Whether it needs a board, and so flies one flight at a time.
    pub const fn is_hardware(self) -> bool {
        matches!(self, Self::Loopback | Self::Transmitter)
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// One combination of a case's rigs, missions, modes, effects and seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Test {
    /// The place of its case in [`Suite::cases`].
    pub case: usize,
    /// Names it within the suite: the case's name, then what the case lists several of, with slashes between.
    pub id: String,
    /// A name for its files, made of the id, of letters, digits and `._-=` alone. No two tests have the same.
    pub file_stem: String,
    /// The rig as it is named.
    pub rig: String,
    /// The mission as it is named.
    pub mission: String,
    /// How it is flown.
    pub mode: Mode,
    /// Effects added to the rig, as `--effect` takes them.
    pub effects: Vec<String>,
    /// Seed of its first repeat.
    pub seed: u64,
}

impl Test {
    /// The seed of a repeat, counted from zero. On the simulator a repeat is the same flight with other noise.
    pub fn seed_of(&self, repeat: u32) -> u64 {
        self.seed + u64::from(repeat) * SEEDS_APART
    }
}

/// Between the seeds of two repeats.
const SEEDS_APART: u64 = 1000;

impl Suite {
    /// The tests of all cases, in the order of the file: the seed changes first, then effects, mode, mission, rig.
    pub fn tests(&self) -> Vec<Test> {
        let mut stems = BTreeSet::new();
        let mut tests = Vec::new();
        for (index, case) in self.cases.iter().enumerate() {
            tests.extend(case.tests(index));
        }
        for test in &mut tests {
            let plain = file_stem(&test.id);
            let mut stem = plain.clone();
            let mut count = 1;
            while !stems.insert(stem.clone()) {
                count += 1;
                stem = format!("{plain}-{count}");
            }
            test.file_stem = stem;
        }
        tests
    }
}

impl Case {
    /// Whether its two rigs belong to its two modes: the first to the first, the second to the second. A loopback bench and a real
    /// airframe are two rigs, and are compared all the same.
    pub fn pairs_rigs_with_modes(&self) -> bool {
        self.compare.back_to_back && self.rigs.len() == 2 && self.modes.len() == 2
    }

    fn tests(&self, index: usize) -> Vec<Test> {
        let mut tests = Vec::new();
        let belongs = |rig: usize, mode: usize| rig == mode || !self.pairs_rigs_with_modes();
        for (rig_index, rig) in self.rigs.iter().enumerate() {
            for mission in &self.missions {
                for (_, mode) in self.modes.iter().enumerate().filter(|(mode, _)| belongs(rig_index, *mode)) {
                    for effects in &self.effects {
                        for seed in &self.seeds {
                            tests.push(Test {
                                case: index,
                                id: self.id(rig, mission, *mode, effects, *seed),
                                file_stem: String::new(),
                                rig: rig.clone(),
                                mission: mission.clone(),
                                mode: *mode,
                                effects: effects.clone(),
                                seed: *seed,
                            });
                        }
                    }
                }
            }
        }
        tests
    }

    fn id(&self, rig: &str, mission: &str, mode: Mode, effects: &[String], seed: u64) -> String {
        let mut id = self.name.clone();
        let mut add = |count: usize, part: &str| {
            if count > 1 {
                id.push('/');
                id.push_str(part);
            }
        };
        // Where each mode has its rig, the mode says all.
        add(if self.pairs_rigs_with_modes() { 1 } else { self.rigs.len() }, rig);
        add(self.missions.len(), mission);
        add(self.modes.len(), mode.name());
        let effects = if effects.is_empty() { "none".to_owned() } else { effects.join("+") };
        add(self.effects.len(), &effects);
        add(self.seeds.len(), &format!("seed{seed}"));
        id
    }
}

/// Longest part of a name that comes from the id: all usual file systems take it with what is added.
const STEM_MAX: usize = 150;

/// A name as that of a file, without ending: letters, digits and `._-=`, and no more of them than file systems take.
pub fn file_stem(id: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "._-=".contains(c) { c } else { '_' };
    let stem: String = id.chars().map(plain).take(STEM_MAX).collect();
    // A leading dot would hide the file.
    format!("{}{}", if stem.starts_with('.') { "_" } else { "" }, stem)
}

//! Tables of balance readings: CSV to forces, whatever way the airframe is mounted.

use std::path::{Path, PathBuf};

use bench_rig::{Actuation, GRAVITY_M_S2, Rig};
use serde::Serialize;

use crate::error::IdentifyError;

/// How thrust comes to the balance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mounting {
    /// The balance carries the hanging airframe and all that holds it: `reading = hanging - thrust` (paper, section 3.4,
    /// figure 8). What hangs is what it shows while the rotors rest.
    #[default]
    Suspended,
    /// The same with the balance zeroed while the airframe hangs at rest: `reading = -thrust`.
    Tared,
    /// Thrust presses on the balance (airframe upside down, or on a lever), zeroed at rest: `reading = thrust`.
    Pressing,
}

impl Mounting {
    /// What a newton of thrust does to the reading, N.
    pub(crate) fn sign(self) -> f64 {
        match self {
            Self::Suspended | Self::Tared => -1.0,
            Self::Pressing => 1.0,
        }
    }
}

/// One row that has a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Line in the file, counted from one.
    pub line: u64,
    /// In the rig's unit.
    pub throttle: f64,
    /// What the balance shows, N.
    pub shown_n: f64,
    /// Height above the surface, m, where the table has it.
    pub altitude_m: Option<f64>,
    /// Which battery level, an index into [`Readings::levels`].
    pub level: usize,
}

/// A reading that is not used, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refused {
    /// Line in the file, counted from one.
    pub line: u64,
    /// In the rig's unit, where the row has it.
    pub throttle: Option<f64>,
    /// Thrust as the reading has it, N, where there is a reading.
    pub thrust_n: Option<f64>,
    /// Why.
    pub why: String,
}

/// A table of readings.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// The file.
    pub file: PathBuf,
    /// Names of the battery levels in the order of the file; one without a name where there is no such column.
    pub levels: Vec<String>,
    /// The rows with a reading.
    pub rows: Vec<Reading>,
    /// The balance's step, N.
    pub resolution_n: f64,
    /// Rows without a reading.
    pub refused: Vec<Refused>,
    /// Unit of the altitudes in the file.
    pub altitude_unit: &'static str,
    /// Whether the readings' column says that it is thrust (`thrust_g`, `thrust_n`).
    pub is_thrust: bool,
}

const FORCES: [(&str, f64, bool); 6] = [
    ("reading_g", GRAVITY_M_S2 / 1000.0, false),
    ("reading_n", 1.0, false),
    ("reading_mn", 1e-3, false),
    ("thrust_g", GRAVITY_M_S2 / 1000.0, true),
    ("thrust_n", 1.0, true),
    ("thrust_mn", 1e-3, true),
];
const ALTITUDES: [(&str, f64, &str); 3] =
    [("altitude_m", 1.0, "m"), ("altitude_cm", 0.01, "cm"), ("altitude_mm", 0.001, "mm")];

struct Columns {
    throttle: usize,
    force: (usize, f64, bool),
    altitude: Option<(usize, f64, &'static str)>,
    battery: Option<usize>,
}

impl Readings {
    /// Reads a CSV with a line of column names: `throttle` (or with the rig's unit, as `throttle_v`); one of `reading_g`,
    /// `reading_n`, `reading_mn`, or `thrust_g` and so on where the weight has been taken off; optionally `altitude_m`, `_cm`
    /// or `_mm`, and `battery`, a name or number of the battery's level. Lines that begin with `#` and other columns are not
    /// read.
    pub fn load(file: &Path, rig: &Rig) -> Result<Self, IdentifyError> {
        let text = std::fs::read_to_string(file).map_err(|error| IdentifyError::Table {
            file: file.to_owned(),
            detail: format!("cannot read it: {error}"),
        })?;
        Self::read(file, &text, rig)
    }

    /// The same from text; `file` is for the messages.
    pub fn read(file: &Path, text: &str, rig: &Rig) -> Result<Self, IdentifyError> {
        let table = |detail: String| IdentifyError::Table { file: file.to_owned(), detail };
        // The byte order mark that spreadsheets write.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut reader =
            csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
        let names = reader.headers().map_err(|error| table(error.to_string()))?.clone();
        let columns = Columns::of(&names, rig.airframe.actuation).map_err(table)?;
        let (force_at, newtons, is_thrust) = columns.force;
        let mut out = Self {
            file: file.to_owned(),
            levels: Vec::new(),
            rows: Vec::new(),
            resolution_n: 0.0,
            refused: Vec::new(),
            altitude_unit: columns.altitude.map_or("m", |(_, _, unit)| unit),
            is_thrust,
        };
        let mut decimals = 0;
        for row in reader.records() {
            let row = row.map_err(|error| table(error.to_string()))?;
            let line = row.position().map_or(0, csv::Position::line);
            let number = |column: usize| -> Result<Option<f64>, IdentifyError> {
                let text = row.get(column).unwrap_or("");
                match text.parse::<f64>() {
                    _ if text.is_empty() => Ok(None),
                    Ok(x) if x.is_finite() => Ok(Some(x)),
                    _ => Err(IdentifyError::Cell {
                        file: file.to_owned(),
                        line,
                        column: names.get(column).unwrap_or("").to_owned(),
                        text: text.to_owned(),
                    }),
                }
            };
            let throttle = number(columns.throttle)?;
            let shown = number(force_at)?;
            let altitude = columns.altitude.map(|(at, _, _)| number(at)).transpose()?.flatten();
            let (Some(throttle), Some(shown)) = (throttle, shown) else {
                out.refused.push(Refused {
                    line,
                    throttle,
                    thrust_n: None,
                    why: "a cell is empty".to_owned(),
                });
                continue;
            };
            decimals = decimals.max(places(row.get(force_at).unwrap_or("")));
            out.inside(rig, line, throttle)?;
            let name = columns.battery.and_then(|at| row.get(at)).unwrap_or("");
            let level = out.levels.iter().position(|known| known == name).unwrap_or_else(|| {
                out.levels.push(name.to_owned());
                out.levels.len() - 1
            });
            let altitude_m = altitude.map(|x| x * columns.altitude.map_or(1.0, |(_, metres, _)| metres));
            out.rows.push(Reading { line, throttle, shown_n: shown * newtons, altitude_m, level });
        }
        if out.rows.is_empty() {
            return Err(table("it holds no reading".to_owned()));
        }
        out.resolution_n = 10_f64.powi(-decimals) * newtons;
        Ok(out)
    }

    /// Refuses a throttle that the rig cannot command.
    fn inside(&self, rig: &Rig, line: u64, throttle: f64) -> Result<(), IdentifyError> {
        let (min, max) = (rig.airframe.sticks.min, rig.airframe.sticks.max);
        let slack = 0.02 * (max - min);
        if (min - slack..=max + slack).contains(&throttle) {
            return Ok(());
        }
        let thousandth = throttle / 1000.0;
        let hint = if (min + 0.05 * (max - min)..=max).contains(&thousandth) {
            ": 1000 times too much, as thousandths of it (mV)?"
        } else {
            ""
        };
        let unit = rig.airframe.actuation.unit();
        Err(IdentifyError::ThrottleOutside { file: self.file.clone(), line, throttle, min, max, unit, hint })
    }
}

impl Columns {
    fn of(names: &csv::StringRecord, actuation: Actuation) -> Result<Self, String> {
        let at = |name: &str| names.iter().position(|column| column.eq_ignore_ascii_case(name));
        let own = format!("throttle_{}", actuation.suffix());
        let found = || match names.len() {
            0 => "nothing".to_owned(),
            _ => names.iter().collect::<Vec<_>>().join(", "),
        };
        let Some(throttle) = at(&own).or_else(|| at("throttle")) else {
            let other = Actuation::CHOICES.iter().find_map(|(_, choice)| {
                let name = format!("throttle_{}", choice.suffix());
                at(&name).map(|_| name)
            });
            return Err(match other {
                Some(other) => format!(
                    "it has `{other}`, while the rig's throttle is `{own}`: another rig, or convert the column"
                ),
                None => format!("no column `{own}` or `throttle`; it has {}", found()),
            });
        };
        let forces: Vec<_> = FORCES
            .iter()
            .filter_map(|(name, newtons, thrust)| Some((at(name)?, *newtons, *thrust)))
            .collect();
        let force = match forces.as_slice() {
            [one] => *one,
            [] => {
                return Err(format!(
                    "no column of readings; expected one of {}; it has {}",
                    FORCES.map(|(name, ..)| name).join(", "),
                    found()
                ));
            }
            _ => return Err(format!("more than one column of readings among {}; keep one", found())),
        };
        let altitude = ALTITUDES.iter().find_map(|(name, metres, unit)| Some((at(name)?, *metres, *unit)));
        Ok(Self { throttle, force, altitude, battery: at("battery") })
    }
}

/// Decimal places of a number as written.
fn places(text: &str) -> i32 {
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let written =
        mantissa.split_once('.').map_or(0, |(_, after)| i32::try_from(after.len()).unwrap_or(i32::MAX / 2));
    written.saturating_sub(exponent.parse::<i32>().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
    }

    fn read(text: &str) -> Result<Readings, IdentifyError> {
        Readings::read(Path::new("balance.csv"), text, &rig())
    }

    #[test]
    fn units_levels_resolution_and_comments_are_read() {
        let found = read(
            "\u{feff}# by hand\nThrottle_V, reading_g, battery, altitude_mm, note\n0, 15.0, full, 5, a\n1.9, 1.2, full, 5, b\n1.9, 2.05, half, 10, c\n2.0, , half, 10, d\n",
        )
        .unwrap();
        assert_eq!(found.levels, ["full", "half"]);
        assert_eq!(found.rows.len(), 3);
        let last = found.rows[2];
        assert_eq!((last.line, last.throttle, last.altitude_m, last.level), (5, 1.9, Some(0.01), 1));
        assert!((last.shown_n - 2.05 * GRAVITY_M_S2 / 1000.0).abs() < 1e-15);
        assert!((found.resolution_n - 0.01 * GRAVITY_M_S2 / 1000.0).abs() < 1e-15);
        assert_eq!(found.refused[0].line, 6);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        for (text, words) in [
            ("throttle_v,reading_g\n1.0,ten\n", "balance.csv:2: column `reading_g` has \"ten\""),
            (
                "throttle_v,reading_g\n1900,10\n",
                "balance.csv:2: throttle 1900 is outside the rig's 0 to 3.3 V: 1000 times too much",
            ),
            ("throttle_count,reading_g\n1,10\n", "while the rig's throttle is `throttle_v`"),
            ("throttle_v,mass\n1,10\n", "no column of readings; expected one of reading_g"),
            ("throttle_v,reading_g,reading_n\n1,10,2\n", "more than one column"),
            ("throttle_v,reading_g\n", "no reading"),
            ("throttle_v,reading_g\n1,2,3\n", "record 1"),
        ] {
            let told = read(text).unwrap_err().to_string();
            assert!(told.contains(words), "{told}");
        }
    }
}

//! One flight: its verdict and its sections.

use std::path::{Path, PathBuf};

use bench_page::{
    Section, Tone, Verdict,
    parts::{Column, Tile, badge, cell, facts, folded, passed, table, tiles, warnings},
};
use bench_recording::{Event, Flight, Info, Level, Session};
use bench_rig::{Mission, Rig, keys::Form};
use bench_run::{Check, Summary, check};
use maud::{Markup, html};

use super::{Loaded, settings, timing, traces};
use crate::words::{self, short};

/// A recording, held against its mission.
pub struct Flown {
    path: PathBuf,
    flight: Flight,
    pub(super) info: Info,
    pub(super) summary: Summary,
    rig: Option<Rig>,
    mission: Option<Mission>,
    checks: Vec<Check>,
    warnings: Vec<String>,
}

impl Flown {
    /// Holds a recording against the mission that it carries.
    pub fn new(loaded: Loaded) -> Self {
        let Loaded { path, flight, info, mut warnings, .. } = loaded;
        let within = |name: &str| PathBuf::from(format!("{}/{name}", path.display()));
        let mut read = |what: &str, error: String| {
            warnings.push(format!("the {what} that {} carries cannot be read: {error}", path.display()));
        };
        let rig = flight.rig_toml().and_then(|text| {
            Rig::read(&within("rig.toml"), text).map_err(|error| read("rig", error.to_string())).ok()
        });
        let mission = flight.mission_toml().and_then(|text| {
            let mission = Mission::read(&within("mission.toml"), text);
            mission.map_err(|error| read("mission", error.to_string())).ok()
        });
        let summary =
            Summary::of_flight(&flight, mission.as_ref().and_then(|mission| mission.criteria.settle_band_m));
        let checks = mission.as_ref().map(|mission| check(&mission.criteria, &summary)).unwrap_or_default();
        Self { path, flight, info, summary, rig, mission, checks, warnings }
    }

    /// The file's name.
    pub fn name(&self) -> String {
        words::file_name(&self.path)
    }

    /// What should be known of how whole the recording is.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn stopped(&self) -> Option<&Event> {
        self.flight.events.iter().find(|event| event.level == Level::Error)
    }

    /// What the flight comes to, in a word.
    pub(super) fn judged(&self) -> (Tone, &'static str) {
        if self.stopped().is_some() {
            (Tone::Bad, "stopped")
        } else if self.checks.is_empty() {
            (Tone::Plain, "no criteria")
        } else if self.checks.iter().all(|check| check.passed) {
            (Tone::Good, "passed")
        } else {
            (Tone::Bad, "missed")
        }
    }

    /// What the flight comes to.
    pub fn tone(&self) -> Tone {
        self.judged().0
    }

    /// Events that are warnings or errors.
    pub(super) fn notable(&self) -> usize {
        self.flight.events.iter().filter(|event| event.level > Level::Info).count()
    }

    /// What the flight comes to, with its figures.
    pub fn verdict(&self) -> Verdict {
        let missed = self.checks.iter().filter(|check| !check.passed).count();
        let words = match (self.stopped(), self.checks.len()) {
            (Some(event), _) => format!("Not flown to its end: {}", event.text),
            (None, 0) => format!("{:.1} s of flight, without criteria", self.info.duration_s),
            (None, 1) if missed == 0 => "The flight met its criterion".to_owned(),
            (None, all) if missed == 0 => format!("The flight met all {all} criteria"),
            (None, all) => format!("The flight missed {missed} of {all} criteria"),
        };
        let description =
            self.mission.as_ref().map(|mission| mission.description.as_str()).unwrap_or_default();
        let below = html! {
            @if !description.is_empty() { p.lead { (self.info.mission) ": " (description) } }
            (facts(self.particulars()))
            (warnings(&self.warnings))
            (self.figures())
        };
        Verdict::new(self.tone(), words).with(below)
    }

    fn particulars(&self) -> Vec<(&'static str, String)> {
        let info = &self.info;
        let airframe = self.rig.as_ref().map(|rig| rig.airframe.name.clone()).unwrap_or_default();
        let added = info.extra.get(Session::ADDED_EFFECTS).cloned().unwrap_or_default();
        let extra =
            info.extra.iter().filter(|(key, value)| *key != Session::ADDED_EFFECTS && is_short(value));
        let extra: Vec<String> = extra.map(|(key, value)| format!("{key} {value}")).collect();
        vec![
            ("recording", self.path.display().to_string()),
            ("mode", info.mode.clone()),
            ("rig", info.rig.clone()),
            ("airframe", airframe),
            ("mission", info.mission.clone()),
            ("seed", info.seed.map(|seed| seed.to_string()).unwrap_or_default()),
            ("added effects", added),
            ("length", format!("{:.1} s", info.duration_s)),
            ("held", format!("{}, {}", words::count(info.messages, "message"), words::size(info.size_bytes))),
            ("recorded by", format!("bench {} on {}", info.bench_version, info.platform)),
            ("besides", extra.join(", ")),
        ]
    }

    fn figures(&self) -> Markup {
        let s = &self.summary;
        let figure = |value: Option<String>, of: &str, beside: String| {
            value.map(|value| Tile { value, of: of.to_owned(), beside })
        };
        let centimetres = |m: Option<f64>| m.map(|m| format!("{:.1} cm", 100.0 * m));
        let ms = |s: f64| format!("{} ms", bench_page::digits(1e3 * s));
        let overshoot =
            centimetres(s.overshoot_m).map(|x| format!("{x} above the set-point")).unwrap_or_default();
        let sideways =
            centimetres(s.lateral_rms_error_m).map(|x| format!("sideways {x}")).unwrap_or_default();
        let overran =
            if s.overruns == 0 { "none overran".to_owned() } else { format!("{} overran", s.overruns) };
        let latest = if s.lateness_max_s > 0.0 {
            format!(", latest start {}", ms(s.lateness_max_s))
        } else {
            String::new()
        };
        let figures = [
            figure(s.peak_m.map(|m| format!("{m:.3} m")), "highest altitude seen", overshoot),
            figure(centimetres(s.rms_error_m), "RMS error of altitude in the last hold", sideways),
            figure(s.settling_time_s.map(|s| format!("{s:.1} s")), "until it settled", String::new()),
            figure(
                s.rebound_m.map(|m| format!("{:.1} cm", 100.0 * m)),
                "lowest point of the rebound",
                String::new(),
            ),
            figure(
                (s.ticks > 0).then(|| words::grouped(s.ticks)),
                "iterations of the loop",
                format!("{overran}{latest}"),
            ),
        ];
        tiles(figures.into_iter().flatten())
    }

    /// The parts of the page of one flight.
    pub fn sections(&self) -> Vec<Section> {
        let group = self.path.display().to_string();
        let sections = [
            self.criteria(),
            Some(traces::section(&self.flight, self.rig.as_ref(), &group)),
            timing::section(&self.flight, self.rig.as_ref(), &self.summary, &group),
            Some(events(&self.flight)),
            Some(self.settings()),
        ];
        sections.into_iter().flatten().collect()
    }

    fn criteria(&self) -> Option<Section> {
        if self.checks.is_empty() {
            return None;
        }
        let forms = Mission::keys();
        let rows = self.checks.iter().map(|check| {
            let limit = format!("{} {}", if check.at_least { "at least" } else { "at most" }, short(check.limit));
            vec![
                html! { (settings::meaning(&forms, &["criteria", check.key]).unwrap_or_default()) " " code { (check.key) } },
                cell(check.value.map_or_else(|| "not reached".to_owned(), short)),
                cell(limit),
                passed(check.passed),
            ]
        });
        let columns = [
            Column::Words("criterion of the mission"),
            Column::Number("reached"),
            Column::Number("limit"),
            Column::Words(""),
        ];
        let words = "Positions are those that the tracker saw; units stand in the keys.";
        Some(Section::new("Criteria", table(&columns, rows)).told(words))
    }

    fn settings(&self) -> Section {
        let of = |what: &str, text: Option<&str>, forms: &[Form]| {
            let Some(text) = text else {
                return html! { p.soft { "No " (what) " is attached to this recording." } };
            };
            settings::folded_file(what, Path::new(what), text, forms)
        };
        let body = html! {
            (of("rig", self.flight.rig_toml(), &Rig::keys()))
            (of("mission", self.flight.mission_toml(), &Mission::keys()))
            (settings::channels(&self.info))
            @for (key, text) in self.info.extra.iter().filter(|(_, text)| !is_short(text)) {
                (folded(key, "", false, html! { pre { (text) } }))
            }
        };
        Section::new("Rig, mission and channels", body)
    }
}

/// Whether a text of the session can stand in a line among others.
fn is_short(text: &str) -> bool {
    text.len() <= 120 && !text.contains('\n')
}

/// Most events that stand in the open.
const EVENTS: usize = 40;

fn events(flight: &Flight) -> Section {
    let row = |event: &Event| {
        let tone = match event.level {
            Level::Info => None,
            Level::Warning => Some((Tone::Odd, "warning")),
            Level::Error => Some((Tone::Bad, "error")),
        };
        vec![
            cell(format!("{:.3}", event.time.seconds())),
            html! { @if let Some((tone, word)) = tone { (badge(tone, word)) } @else { span.soft { "info" } } },
            cell(event.text.as_str()),
        ]
    };
    let columns = [Column::Number("time, s"), Column::Words(""), Column::Words("what happened")];
    let all = &flight.events;
    let body = if all.is_empty() {
        html! { p { "None was recorded." } }
    } else if all.len() <= EVENTS {
        table(&columns, all.iter().map(row))
    } else {
        let notable: Vec<&Event> =
            all.iter().filter(|event| event.level > Level::Info).take(EVENTS).collect();
        html! {
            (table(&columns, notable.into_iter().map(row)))
            (folded(words::count(all.len() as u64, "event"), "all of them", false, table(&columns, all.iter().map(row))))
        }
    };
    Section::new("Events", html! { div.tight { (body) } })
}

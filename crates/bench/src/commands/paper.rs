//! The paper's figures, made by the bench.

mod series;
mod statements;

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_filter::Track;
use bench_identification::{
    GroundIdentification, OpenLoop, Readings, ThrustIdentification, ThrustOptions, Tolerance, Verification,
    identify_flights, identify_ground_effect, identify_thrust, verify,
};
use bench_page::{
    Mark, Page, Panel, Plot, Section, Series, Tone, Verdict,
    parts::{Column, block, cell, code, passed, table},
};
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Options, Record, Recorder, Session};
use bench_rig::{Mission, Model, Phase, Rig};
use bench_run::{Ending, Sink, simulate};
use clap::Args;
use maud::html;
use serde::Serialize;

use self::{
    series::{seen, seen_speed, true_altitude, true_speed},
    statements::Statement,
};
use super::verify::open_loop;
use crate::{
    arguments::{Force, Json, RigArgument},
    balance::Plan,
    exit::Exit,
    files::{self, Form, Outputs},
    model_page::{ground_figure, thrust_figure, trajectory_figure},
    progress::Progress,
    recorded::added_effects,
    report::less_between,
    words,
};

/// Make the paper's figures 4, 9, 10, 11, 15 and 16 with the bench itself, beside what the paper says of them
#[derive(Args)]
#[command(after_help = "Examples:
  bench paper -o paper/ && xdg-open paper/index.html
  bench paper --rig virtual --seed 3 -o paper-3/ --json

It goes the paper's way: readings of an emulated balance, gain and offset from them, the ground
effect, a rig with these numbers; then flights of the virtual lab in gusty air against that
rig's model, open loop and closed. Into the folder go the figures as SVG, index.html with the
table of what is stated and what was made, the readings, the rig and the recordings. Exit code 1
says that something stated was not met.")]
pub struct Arguments {
    /// Folder for figures, page, readings, rig and recordings
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    rig: RigArgument,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

/// Loss of thrust by the emulated battery: the paper's figure 9 shows a small one and gives no number.
const DISCHARGE: &str = "battery-discharge:loss_per_hover_minute=0.01";
/// The air of the laboratory.
const GUSTS: &str = "gusts:sigma_m_s=0.02,correlation_time_s=0.7";
/// Flights from which the model is refined, hops and climbs in turn.
const TUNING_FLIGHTS: u64 = 4;

#[derive(Serialize)]
struct Made<'a> {
    schema: &'static str,
    passed: bool,
    statements: &'a [Statement],
    figures: Vec<String>,
}

/// All that the figures are made of.
struct Work {
    lab: Rig,
    rig: Rig,
    thrust: ThrustIdentification,
    ground: GroundIdentification,
    hop: Flight,
    /// By the numbers from the balance alone, and with what other flights told.
    hop_verified: [Verification; 2],
    climb: Flight,
    model_climb: Flight,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force).and(arguments.output.as_path(), Form::Folder).check()?;
    let work = Work::through(arguments)?;
    let statements = work.statements();
    let figures = work.figures();
    for (name, figure, _) in &figures {
        files::write(&arguments.output.join(format!("{name}.svg")), &format!("{}\n", figure.svg()))?;
    }
    let page = arguments.output.join("index.html");
    files::write(&page, &work.page(&statements, &figures, arguments))?;
    let passed = statements.iter().all(|one| one.passed);
    if arguments.json.json {
        let figures = figures.iter().map(|(name, ..)| format!("{name}.svg")).collect();
        words::print_json(&Made { schema: "bench.paper/1", passed, statements: &statements, figures })?;
    } else {
        let mut out = String::new();
        for one in &statements {
            let verdict = words::passed(one.passed);
            // Writing to a String cannot fail.
            let _ = writeln!(
                out,
                "{verdict}  figure {:<3} {}\n        made: {}",
                one.figure, one.stated, one.made
            );
        }
        let _ = write!(
            out,
            "\n{} and {} beside it",
            page.display(),
            words::count(figures.len() as u64, "figure")
        );
        words::print(&out)?;
    }
    Ok(if passed { Exit::Done } else { Exit::CheckFailed })
}

impl Work {
    /// Measure, identify, verify, fly.
    fn through(arguments: &Arguments) -> anyhow::Result<Self> {
        let folder = &arguments.output;
        let lab = arguments.rig.load()?;
        let rig_file = arguments.rig.path();
        let (hop, climb) = (files::mission("hop", rig_file)?, files::mission("climb-040", rig_file)?);

        let progress = Progress::of("paper");
        progress.begin_untold("balance: throttle, thrust and altitude");
        let mut on_balance = lab.clone();
        on_balance.effects.push(parse_effect(DISCHARGE)?);
        let seed = arguments.seed;
        let made = format!("# made by {}\n", words::command());
        let table = |name: &str, plan: Plan, rig: &Rig| -> anyhow::Result<Readings> {
            let path = folder.join(name);
            let text = made.clone() + &Plan { seed: seed + 1, ..plan }.readings(rig)?;
            files::write(&path, &text)?;
            Ok(Readings::load(&path, &lab)?)
        };
        let options = ThrustOptions::default();
        let thrust = identify_thrust(&table("thrust.csv", Plan::thrust(&lab), &on_balance)?, &lab, &options)?;
        let ground_readings = table("ground.csv", Plan::ground(&lab), &lab)?;
        let ground = identify_ground_effect(&ground_readings, &thrust.rig, &options, false)?;
        let from_balance = ground.rig.clone();
        files::write_rig(
            &folder.join("rig-balance.toml"),
            "gain, offset and ground effect by `bench paper` from its own readings.",
            &from_balance,
        )?;

        progress.begin(
            "flights of the laboratory, for what the balance does not tell",
            TUNING_FLIGHTS as f64,
            "flights",
        );
        let mut air = lab.clone();
        air.effects.push(parse_effect(GUSTS)?);
        let mut tracks = Vec::new();
        for i in 0..TUNING_FLIGHTS {
            let mission = if i % 2 == 0 { &hop } else { &climb };
            let name = format!("tuning-{}.mcap", i + 1);
            let flight = fly(&air, &lab, mission, seed + 1 + i, &folder.join(&name))?;
            tracks.push(Track::from_flight(&name, &flight, &from_balance)?);
            progress.step();
        }
        progress.begin_untold("refining the rig by these flights");
        let rig = identify_flights(&tracks, &from_balance)?.rig;
        let head =
            "rig-balance.toml refined by `bench paper` as `bench identify flight` does, from tuning-*.mcap.";
        files::write_rig(&folder.join("rig.toml"), head, &rig)?;

        progress.begin_untold("figures 11, 15 and 16: another hop and climb, and the model");
        let hop = fly(&air, &lab, &hop, seed, &folder.join("hop.mcap"))?;
        let against = |rig: &Rig| -> anyhow::Result<Verification> {
            let open: OpenLoop = open_loop("Figure 11: a hop at one throttle", &hop, rig)?;
            Ok(verify(&[open], rig, &Tolerance::default())?)
        };
        let hop_verified = [against(&from_balance)?, against(&rig)?];
        let climb_flight = fly(&air, &lab, &climb, seed, &folder.join("climb.mcap"))?;
        let calm = calm(&rig);
        let model_climb = fly(&calm, &calm, &climb, seed, &folder.join("climb-model.mcap"))?;
        Ok(Self { lab, rig, thrust, ground, hop, hop_verified, climb: climb_flight, model_climb })
    }

    fn figures(&self) -> Vec<(&'static str, Plot, &'static str)> {
        vec![
            (
                "figure-4",
                self.figure_4(),
                "What the paper's user interface shows of a flight: altitude as the tracker saw it, and altitude and vertical speed as the controller took them, predicted over the delay.",
            ),
            (
                "figure-9",
                thrust_figure(&self.thrust, &self.rig, "Figure 9: thrust over throttle"),
                "Readings of the emulated balance at two levels of charge, weight taken off, and the lines fitted to them; crosses are refused.",
            ),
            (
                "figure-10",
                ground_figure(&self.ground, "Figure 10: thrust over altitude"),
                "Thrust at three throttles over altitude, with the linear law.",
            ),
            (
                "figure-11",
                self.figure_11(),
                "One throttle all the time, which is all that the model is told. Its numbers are from the balance, refined by four other flights as in the paper's section 3.5; dashed is the balance alone. The bands hold 50 and 95 % of trajectories within its tolerances.",
            ),
            (
                "figure-15",
                self.figure_15(),
                "Altitude of a climb to 0.4 m: the virtual laboratory as its tracker saw it, and the model with the identified numbers in calm air. Below, what the tracker saw less the model's altitude at the same time, in centimetres.",
            ),
            (
                "figure-16",
                self.figure_16(),
                "Vertical speed of the same: slope of what was seen over 0.2 s, and the model's. Below, the slope less the model's speed at the same time.",
            ),
        ]
    }

    fn figure_4(&self) -> Plot {
        let states = || self.climb.states.iter();
        let altitude = states().map(|s| (s.time.seconds(), s.estimate_m[2]));
        let speed = states().map(|s| (s.time.seconds(), s.estimate_m_s[2]));
        let panel = Panel::new("altitude, m; speed, m/s")
            .with(Series::new("seen, m", Mark::Dots, 1, seen(&self.climb)))
            .with(Series::new("altitude, m", Mark::Steps, 0, altitude))
            .with(Series::new("speed, m/s", Mark::Steps, 2, speed));
        Plot::new("Figure 4: vertical trace", "time, s").panel(panel)
    }

    fn figure_11(&self) -> Plot {
        let [first, refined] = &self.hop_verified;
        let refined = &refined.flights[0];
        trajectory_figure(refined, &refined.name, first.flights.first())
    }

    fn figure_15(&self) -> Plot {
        let wanted = self.climb.states.iter().filter(|s| s.phase == Phase::Hold);
        let wanted = wanted.map(|s| (s.time.seconds(), s.setpoint_m[2]));
        let panel = Panel::new("altitude, m")
            .with(Series::new("wanted", Mark::Dashed, 5, wanted))
            .with(Series::new("model", Mark::Line, 0, true_altitude(&self.model_climb)))
            .with(Series::new("flight", Mark::Dots, 1, seen(&self.climb)));
        let off = less_between(&seen(&self.climb), &true_altitude(&self.model_climb), 100.0);
        Plot::new("Figure 15: altitude of a climb to 0.4 m", "time, s")
            .panel(panel)
            .panel(difference("flight \u{2212} model, cm", off))
            .group("climb")
    }

    fn figure_16(&self) -> Plot {
        let panel = Panel::new("speed, m/s")
            .with(Series::new("flight", Mark::Line, 1, seen_speed(&self.climb)))
            .with(Series::new("model", Mark::Line, 0, true_speed(&self.model_climb)));
        let off = less_between(&seen_speed(&self.climb), &true_speed(&self.model_climb), 1.0);
        Plot::new("Figure 16: vertical speed of the same climb", "time, s")
            .panel(panel)
            .panel(difference("flight \u{2212} model, m/s", off))
            .group("climb")
    }

    fn page(
        &self,
        statements: &[Statement],
        figures: &[(&'static str, Plot, &'static str)],
        arguments: &Arguments,
    ) -> String {
        let met = statements.iter().filter(|one| one.passed).count();
        let below = html! {
            p.lead { "S. Wright, Model-based development of MAV altitude control via ground-based equipment: its figures as this bench makes them. Airframe " (self.rig.airframe.name) ", seed " (arguments.seed) "." }
            p { "No real airframe flew here. The laboratory is the virtual one of rig " code { (self.lab.name) } " with " (GUSTS) ", its tracker's noise, rounding and delay and its output's steps; the balance is emulated (" (DISCHARGE) ", 0.08 g of noise, steps of 0.1 g, one reading in 25 off by up to 5 g). The model knows of it what " code { "bench identify" } " found in the readings and in four flights that are not shown, the rig's tolerances being what is known before. That they agree shows that the way of working works; that the laws are right, only a real airframe can show. The paper prints its figures without tables, so what is compared is what it says of them in words." }
        };
        let headline = format!("{met} of {} statements of the paper are met", statements.len());
        let verdict = Verdict::new(Tone::of(met == statements.len()), headline).with(below);
        Page::new("The paper's figures", verdict)
            .sections(figures.iter().map(|(name, figure, words)| of_figure(name, figure, words, statements)))
            .made_by(words::command())
            .html()
    }
}

/// What is off, about a line at zero.
fn difference(title: &str, off: Vec<(f64, f64)>) -> Panel {
    Panel::new(title).with(Series::new("", Mark::Line, 3, off)).level(0.0, "").low()
}

fn of_figure(name: &str, figure: &Plot, words: &str, statements: &[Statement]) -> Section {
    let number = name.trim_start_matches("figure-");
    let of = statements.iter().filter(|one| one.figure.split(", ").any(|figure| figure == number));
    let rows: Vec<Vec<_>> = of
        .map(|one| {
            vec![
                html! { (one.stated) " " span.soft { "(section " (one.section) ")" } },
                cell(&one.made),
                code(one.rule),
                passed(one.passed),
            ]
        })
        .collect();
    let columns = [Column::Words("stated"), Column::Words("made"), Column::Words("rule"), Column::Words("")];
    let file = format!("{name}.svg");
    let body = html! {
        (block("", words, html! { (figure) p.soft { a href=(file) { (file) } } }))
        @if !rows.is_empty() { (table(&columns, rows)) }
    };
    Section::new(format!("Figure {number}"), body)
}

/// The model as the paper simulates it: vertical, in calm air, its tracker late but without noise.
fn calm(rig: &Rig) -> Rig {
    let mut rig = rig.clone();
    rig.plant.model = Model::Vertical;
    rig.output.bits = 0;
    rig.output.readback_noise_fraction = 0.0;
    rig.tracker.noise_m = 0.0;
    rig.tracker.resolution_m = 0.0;
    rig.tracker.dropout_probability = 0.0;
    rig.effects.clear();
    rig
}

/// Flies on a rig that the recording says is `nominal` with effects added.
fn fly(rig: &Rig, nominal: &Rig, mission: &Mission, seed: u64, file: &Path) -> anyhow::Result<Flight> {
    files::make_folder(file)?;
    let mut records: Vec<Record> = Vec::new();
    let flown = simulate(rig, mission, seed, &mut records, |_| true)?;
    if flown.ending != Ending::Complete {
        bail!("the flight of {} was stopped: {:?}", mission.name, flown.ending);
    }
    let session = Session::simulated(nominal, &added_effects(nominal, rig), mission, seed);
    let mut recorder = Recorder::create(file, &session, Options::SIMULATION)?;
    for record in &records {
        recorder.take(*record);
    }
    recorder.finish().with_context(|| format!("cannot record {}", file.display()))?;
    Ok(Flight::from_records(session, records))
}

//! The paper's figures, made by the bench.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_device::TrackStatus;
use bench_diagnosis::Track;
use bench_identification::{
    GroundIdentification, Law, OpenLoop, Readings, ThrustIdentification, ThrustOptions, Tolerance,
    Verification, identify_flights, identify_ground_effect, identify_thrust, verify,
};
use bench_page::{Figure, Mark, escaped};
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Mode, Options, Record, Recorder, Session};
use bench_rig::{Mission, Model, Phase, Rig};
use bench_run::{Ending, Sink, simulate};
use clap::Args;
use serde::Serialize;

use super::verify::open_loop;
use crate::{
    balance::Plan,
    exit::Exit,
    files,
    model_page::{self, card, ground_figure, mark, table, thrust_figure, trajectory_figure},
    words::{self, short, with_sigma},
};

/// Make the paper's figures 4, 9, 10, 11, 15 and 16 with the bench itself, beside what the paper says of them
#[derive(Args)]
#[command(after_help = "Examples:
  bench paper -o paper/ && xdg-open paper/index.html
  bench paper --rig rigs/virtual.toml --seed 3 -o paper/ --json

It goes the paper's way: readings of an emulated balance, gain and offset from them, the ground effect, a rig with these
numbers; then flights of the virtual lab in gusty air against that rig's model, open loop and closed. Into the folder go the
figures as SVG, index.html with the table of what is stated and what was made, the readings, the rig and the recordings.
Exit code 1 says that something stated was not met.")]
pub struct Arguments {
    /// Folder for figures, page, readings, rig and recordings
    #[arg(short, long)]
    output: PathBuf,
    /// Rig that stands for the laboratory, with missions hop and climb-040 beside it
    #[arg(long, default_value = files::DEFAULT_RIG)]
    rig: PathBuf,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print what was stated and made as JSON (schema bench.paper/1)
    #[arg(long)]
    json: bool,
}

/// Loss of thrust by the emulated battery: the paper's figure 9 shows a small one and gives no number.
const DISCHARGE: &str = "battery-discharge:loss_per_hover_minute=0.01";
/// The air of the laboratory.
const GUSTS: &str = "gusts:sigma_m_s=0.02,correlation_time_s=0.7";
/// Flights from which the model is refined, hops and climbs in turn.
const TUNING_FLIGHTS: u64 = 4;
/// A climb that a room calls violent: this fast after a second, m/s.
const VIOLENT_M_S: f64 = 0.5;
/// The altitude of figure 15, m.
const CAPTURE_M: f64 = 0.4;

/// One statement of the paper and what the bench made of it.
#[derive(Clone, Debug, Serialize)]
struct Stated {
    figure: &'static str,
    section: &'static str,
    stated: &'static str,
    made: String,
    rule: &'static str,
    passed: bool,
}

#[derive(Serialize)]
struct Made<'a> {
    schema: &'static str,
    passed: bool,
    statements: &'a [Stated],
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
    if arguments.output.exists() && !arguments.output.is_dir() {
        bail!("{} is not a folder", arguments.output.display());
    }
    let work = Work::through(arguments)?;
    let statements = work.statements();
    let figures = work.figures();
    for (name, figure, _) in &figures {
        files::write(&arguments.output.join(format!("{name}.svg")), &format!("{}\n", figure.svg()))?;
    }
    let page = arguments.output.join("index.html");
    files::write(&page, &work.page(&statements, &figures, arguments))?;
    let passed = statements.iter().all(|one| one.passed);
    if arguments.json {
        let figures = figures.iter().map(|(name, ..)| format!("{name}.svg")).collect();
        words::print_json(&Made { schema: "bench.paper/1", passed, statements: &statements, figures })?;
    } else {
        let mut out = String::new();
        for one in &statements {
            let verdict = if one.passed { "pass" } else { "FAIL" };
            // Writing to a String cannot fail.
            let _ =
                writeln!(out, "{verdict}  figure {:<3} {}\n      made: {}", one.figure, one.stated, one.made);
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
        let lab = files::rig(&arguments.rig)?;
        let rig_file = &arguments.rig;
        let (hop, climb) = (files::mission("hop", rig_file)?, files::mission("climb-040", rig_file)?);

        eprintln!("balance: throttle, thrust and altitude");
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

        eprintln!("flights: hops and climbs of the laboratory, for what the balance does not tell");
        let mut air = lab.clone();
        air.effects.push(parse_effect(GUSTS)?);
        let mut tracks = Vec::new();
        for i in 0..TUNING_FLIGHTS {
            let mission = if i % 2 == 0 { &hop } else { &climb };
            let name = format!("tuning-{}.mcap", i + 1);
            let flight = fly(&air, mission, seed + 1 + i, &folder.join(&name))?;
            tracks.push(Track::from_flight(&name, &flight, &from_balance)?);
        }
        let rig = identify_flights(&tracks, &from_balance)?.rig;
        let head =
            "rig-balance.toml refined by `bench paper` as `bench identify flight` does, from tuning-*.mcap.";
        files::write_rig(&folder.join("rig.toml"), head, &rig)?;

        eprintln!("figures 11, 15 and 16: another hop and climb, and the model");
        let hop = fly(&air, &hop, seed, &folder.join("hop.mcap"))?;
        let against = |rig: &Rig| -> anyhow::Result<Verification> {
            let open: OpenLoop = open_loop("Figure 11: a hop at one throttle", &hop, rig)?;
            Ok(verify(&[open], rig, &Tolerance::default())?)
        };
        let hop_verified = [against(&from_balance)?, against(&rig)?];
        let climb_flight = fly(&air, &climb, seed, &folder.join("climb.mcap"))?;
        let model_climb = fly(&calm(&rig), &climb, seed, &folder.join("climb-model.mcap"))?;
        Ok(Self { lab, rig, thrust, ground, hop, hop_verified, climb: climb_flight, model_climb })
    }

    fn statements(&self) -> Vec<Stated> {
        let mut out = Vec::new();
        self.interface(&mut out);
        self.balance(&mut out);
        self.hop(&mut out);
        self.climb(&mut out);
        out
    }

    /// Figure 4 and section 2.
    fn interface(&self, out: &mut Vec<Stated>) {
        let ticks: Vec<f64> =
            self.climb.ticks.windows(2).map(|pair| pair[1].started.since_s(pair[0].started)).collect();
        let period = middle(&ticks);
        let waits: Vec<f64> =
            self.climb.positions.iter().map(|p| p.arrived_at.since_s(p.exposed_at)).collect();
        let latency = middle(&waits);
        out.push(Stated {
            figure: "4",
            section: "2",
            stated: "an iteration takes 0.1 s, data are 0.3 s late",
            made: format!("{} s, {} s (medians of the recording)", short(period), short(latency)),
            rule: "within 1 %",
            passed: (period - 0.1).abs() < 0.001 && (latency - 0.3).abs() < 0.003,
        });
        let mut seen: Vec<f64> = self.climb.positions.iter().map(|p| p.position_m[2]).collect();
        seen.sort_by(f64::total_cmp);
        let step =
            seen.windows(2).map(|pair| pair[1] - pair[0]).filter(|d| *d > 1e-6).fold(f64::INFINITY, f64::min);
        out.push(Stated {
            figure: "4",
            section: "2",
            stated: "positions resolve 5 mm",
            made: format!("least step between positions seen: {:.1} mm", 1000.0 * step),
            rule: "within 1 %",
            passed: (step - 0.005).abs() < 5e-5,
        });
    }

    /// Figures 9 and 10, and the 5 % of section 3.9.
    fn balance(&self, out: &mut Vec<Stated>) {
        let line = &self.thrust.linearity;
        out.push(Stated {
            figure: "9",
            section: "3.4",
            stated: "thrust is linear in throttle over the range of flight",
            made: format!(
                "curvature {} (p {}), {:.2} % of the weight off the line at most",
                with_sigma(line.curvature),
                words::probability(line.curvature_p),
                100.0 * line.departure_of_weight
            ),
            rule: "p above 0.01, or below 1 % of the weight",
            passed: line.linear,
        });
        let differ = self.thrust.levels_differ.map_or(0.0, |differ| differ.of_weight);
        out.push(Stated {
            figure: "9",
            section: "3.4",
            stated: "from full to half charge thrust changes little",
            made: format!("{:.1} % of the weight at hover (battery: {DISCHARGE})", 100.0 * differ),
            rule: "below 5 %; above 0, or there was but one battery",
            passed: differ > 0.0 && differ < 0.05,
        });
        let a = &self.rig.airframe;
        // v' = excess/m - Cf v/m, out of the ground effect.
        let (mass, drag) = (a.mass_kg.value, a.drag_n_s_per_m.value);
        let rate = drag / mass;
        let per_acceleration = if rate > 0.0 { (1.0 - (-rate).exp()) / rate } else { 1.0 };
        let hover = a.throttle_for(a.weight_n());
        let excess = |speed: f64| {
            (a.throttle_for(a.weight_n() + mass * speed / per_acceleration) - hover) / (hover - a.sticks.min)
        };
        let launch = self.launch_excess(hover);
        out.push(Stated {
            figure: "9",
            section: "3.9",
            stated: "a violent climb takes about 5 % more throttle than hover",
            made: format!(
                "{:.1} % climbs at {VIOLENT_M_S} m/s after 1 s; the launch of figure 15 has {:.1} %",
                100.0 * excess(VIOLENT_M_S),
                100.0 * launch
            ),
            rule: "both from 3 to 7 %",
            passed: [excess(VIOLENT_M_S), launch].iter().all(|x| (0.03..=0.07).contains(x)),
        });
        let [multiplier, height] = &self.ground.numbers;
        out.push(Stated {
            figure: "10",
            section: "3.4",
            stated: "30 % more thrust at the ground",
            made: format!("{:.1} ± {:.1} %", 100.0 * (multiplier.after.0 - 1.0), 100.0 * multiplier.after.1),
            rule: "27 to 33 %",
            passed: (multiplier.after.0 - 1.3).abs() < 0.03,
        });
        out.push(Stated {
            figure: "10",
            section: "3.4",
            stated: "the ground effect ends at about 5 cm",
            made: format!("{:.2} ± {:.2} cm", 100.0 * height.after.0, 100.0 * height.after.1),
            rule: "4.5 to 5.5 cm",
            passed: (height.after.0 - 0.05).abs() < 0.005,
        });
        let best = &self.ground.laws[0];
        let odds = self.ground.laws.iter().filter(|law| law.law != Law::Linear).map(|law| law.nats);
        out.push(Stated {
            figure: "10",
            section: "3.4",
            stated: "a linear fall with altitude is adequate",
            made: format!(
                "best by evidence: {}; the next law is {:.1} nats behind the linear one",
                best.law.name(),
                -odds.fold(f64::MIN, f64::max)
            ),
            rule: "no law is better by 3 nats",
            passed: best.nats < 3.0,
        });
    }

    /// Greatest throttle of the launch over that which hovers, from rest.
    fn launch_excess(&self, hover: f64) -> f64 {
        let launch = self.climb.phases().into_iter().find(|interval| interval.phase == Phase::Launch);
        let min = self.rig.airframe.sticks.min;
        let most = self
            .climb
            .commands
            .iter()
            .filter(|command| launch.is_some_and(|l| command.time >= l.from && command.time < l.to))
            .map(|command| command.sticks.throttle)
            .fold(f64::MIN, f64::max);
        (most - hover) / (hover - min)
    }

    /// Figure 11.
    fn hop(&self, out: &mut Vec<Stated>) {
        let a = &self.rig.airframe;
        let open = self.hop.phases().into_iter().find(|interval| interval.phase == Phase::Open);
        let throttle = open
            .and_then(|open| self.hop.commands.iter().find(|command| command.time >= open.from))
            .map_or(f64::NAN, |command| command.sticks.throttle);
        let beyond = a.thrust_n(throttle) / a.weight_n();
        let ground = beyond * a.ground_effect(0.0);
        out.push(Stated {
            figure: "11",
            section: "3.5",
            stated: "one throttle lifts inside the ground effect and not beyond it",
            made: format!("thrust over weight {ground:.3} at the ground, {beyond:.3} beyond"),
            rule: "above 1, below 1",
            passed: ground > 1.0 && beyond < 1.0,
        });
        let [first, refined] = &self.hop_verified;
        let (first_verified, verified) = (&first.flights[0], &refined.flights[0]);
        let told = &verified.trajectory;
        let height = a.ground_effect.height_m.value;
        for (what, z) in [
            ("it flies a parabola back and rebounds before it touches: in flight", &told.seen_m),
            ("it flies a parabola back and rebounds before it touches: by the model", &told.nominal_m),
        ] {
            let turns = rebound(z);
            out.push(Stated {
                figure: "11",
                section: "3.5",
                stated: what,
                made: turns.map_or_else(
                    || "no rebound".to_owned(),
                    |[peak, trough, again]| {
                        format!(
                            "up to {:.1} cm, down to {:.1} cm, up to {:.1} cm",
                            100.0 * peak,
                            100.0 * trough,
                            100.0 * again
                        )
                    },
                ),
                rule: "above the ground effect, then within it and off the ground, then up by 1 cm",
                passed: turns.is_some_and(|[peak, trough, again]| {
                    peak > height && trough > 0.0 && trough < height && again > trough + 0.01
                }),
            });
        }
        out.push(Stated {
            figure: "11",
            section: "3.5",
            stated: "model and flight agree very closely, after minor changes to what the rig told",
            made: format!(
                "{:.1} cm RMS 1 s ahead; {:.1} cm from the throttle alone ({:.1} cm before the changes), {:.0} % of sightings in the band of 95 %",
                100.0 * verified.k_step_m[1].unwrap_or(f64::NAN),
                100.0 * verified.trajectory_rms_m,
                100.0 * first_verified.trajectory_rms_m,
                100.0 * verified.inside
            ),
            rule: "`bench verify` passes with its usual tolerance and 5 cm from the throttle alone",
            passed: refined.passed && verified.trajectory_rms_m < 0.05,
        });
    }

    /// Figures 15 and 16.
    fn climb(&self, out: &mut Vec<Stated>) {
        for (what, flight, speeds) in [
            ("rapid at first, then momentum is lost: in flight", &self.climb, seen_speed(&self.climb)),
            (
                "rapid at first, then momentum is lost: by the model",
                &self.model_climb,
                true_speed(&self.model_climb),
            ),
        ] {
            let Some(hold) = flight.phases().into_iter().find(|interval| interval.phase == Phase::Hold)
            else {
                continue;
            };
            let hold_s = hold.from.seconds();
            let most = |from: f64, to: f64| {
                speeds
                    .iter()
                    .filter(|(t, _)| (from..to).contains(t))
                    .map(|(_, v)| *v)
                    .fold(f64::MIN, f64::max)
            };
            let (launch, after) = (most(0.0, hold_s + 0.3), most(hold_s + 1.0, hold_s + 5.0));
            out.push(Stated {
                figure: "15, 16",
                section: "3.8",
                stated: what,
                made: format!("{launch:.2} m/s in the launch, at most {after:.2} m/s from 1 to 5 s after it"),
                rule: "above 0.3 m/s, then less than half of it",
                passed: launch > 0.3 && after < 0.5 * launch,
            });
        }
        for (what, z) in [
            ("the loop captures and holds 0.4 m: in flight", seen(&self.climb)),
            ("the loop captures and holds 0.4 m: by the model", true_altitude(&self.model_climb)),
        ] {
            let settled = settled(&self.climb, &z);
            let n = settled.len().max(1) as f64;
            let mean = settled.iter().sum::<f64>() / n;
            let rms = (settled.iter().map(|z| (z - CAPTURE_M).powi(2)).sum::<f64>() / n).sqrt();
            out.push(Stated {
                figure: "15",
                section: "3.8",
                stated: what,
                made: format!("{:.3} m on average over the last 6 s, {:.1} cm RMS off", mean, 100.0 * rms),
                rule: "within 2 cm, 2 cm RMS",
                passed: !settled.is_empty() && (mean - CAPTURE_M).abs() < 0.02 && rms < 0.02,
            });
        }
        let unsteady = |speeds: Vec<(f64, f64)>| {
            let v = settled(&self.climb, &speeds);
            let n = v.len().max(1) as f64;
            let mean = v.iter().sum::<f64>() / n;
            (v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
        };
        let (flight, model) = (unsteady(seen_speed(&self.climb)), unsteady(true_speed(&self.model_climb)));
        out.push(Stated {
            figure: "16",
            section: "3.8",
            stated: "the flight's speed is less steady than the simulation's",
            made: format!("{flight:.3} m/s RMS in the hold, {model:.3} m/s by the model"),
            rule: "more than the model's",
            passed: flight > model,
        });
    }

    fn figures(&self) -> Vec<(&'static str, Figure, &'static str)> {
        vec![
            (
                "figure-4",
                self.figure_4(),
                "What the paper's user interface shows of a flight: altitude as the tracker saw it, and altitude and vertical speed as the controller took them, predicted over the delay.",
            ),
            (
                "figure-9",
                thrust_figure(&self.thrust, &self.rig),
                "Readings of the emulated balance at two levels of charge, weight taken off, and the lines fitted to them; crosses are refused.",
            ),
            (
                "figure-10",
                ground_figure(&self.ground),
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
                "Altitude of a climb to 0.4 m: the virtual laboratory as its tracker saw it, and the model with the identified numbers in calm air.",
            ),
            (
                "figure-16",
                self.figure_16(),
                "Vertical speed of the same: slope of what was seen over 0.2 s, and the model's.",
            ),
        ]
    }

    fn figure_4(&self) -> Figure {
        let mut figure = Figure::new("Figure 4: vertical trace", "time, s", "altitude, m; speed, m/s");
        figure.add("seen, m", Mark::Dots, 1, seen(&self.climb));
        let states = || self.climb.states.iter();
        figure.add("altitude, m", Mark::Steps, 0, states().map(|s| (s.time.seconds(), s.estimate_m[2])));
        figure.add("speed, m/s", Mark::Steps, 2, states().map(|s| (s.time.seconds(), s.estimate_m_s[2])));
        figure
    }

    fn figure_11(&self) -> Figure {
        let [first, refined] = &self.hop_verified;
        let mut figure = trajectory_figure(&refined.flights[0]);
        let told = &first.flights[0].trajectory;
        let before = told.time_s.iter().copied().zip(told.nominal_m.iter().copied());
        figure.add("balance alone", Mark::Dashed, 2, before);
        figure
    }

    fn figure_15(&self) -> Figure {
        let mut figure = Figure::new("Figure 15: altitude of a climb to 0.4 m", "time, s", "altitude, m");
        let wanted = self.climb.states.iter().filter(|s| s.phase == Phase::Hold);
        figure.add("wanted", Mark::Dashed, 5, wanted.map(|s| (s.time.seconds(), s.setpoint_m[2])));
        figure.add("model", Mark::Line, 0, true_altitude(&self.model_climb));
        figure.add("flight", Mark::Dots, 1, seen(&self.climb));
        figure
    }

    fn figure_16(&self) -> Figure {
        let mut figure = Figure::new("Figure 16: vertical speed of the same climb", "time, s", "speed, m/s");
        figure.add("flight", Mark::Line, 1, seen_speed(&self.climb));
        figure.add("model", Mark::Line, 0, true_speed(&self.model_climb));
        figure
    }

    fn page(
        &self,
        statements: &[Stated],
        figures: &[(&'static str, Figure, &'static str)],
        arguments: &Arguments,
    ) -> String {
        let passed = statements.iter().filter(|one| one.passed).count();
        let all = passed == statements.len();
        let mut out = format!(
            "<section class=\"card verdict {}\"><h1>{passed} of {} statements of the paper are met</h1><p class=\"lead\">S. Wright, Model-based development of MAV altitude control via ground-based equipment: its figures as this bench makes them. Airframe {}, seed {}.</p></section>",
            if all { "pass" } else { "fail" },
            statements.len(),
            escaped(&self.rig.airframe.name),
            arguments.seed
        );
        out.push_str(&format!(
            "<section class=\"card\"><p>No real airframe flew here. The laboratory is the virtual one of rig <code>{}</code> with {GUSTS}, its tracker's noise, rounding and delay and its output's steps; the balance is emulated ({DISCHARGE}, 0.08 g of noise, steps of 0.1 g, one reading in 25 off by up to 5 g). The model knows of it what <code>bench identify</code> found in the readings and in four flights that are not shown, the rig's tolerances being what is known before. That they agree shows that the way of working works; that the laws are right, only a real airframe can show. The paper prints its figures without tables, so what is compared is what it says of them in words.</p></section>",
            escaped(&self.lab.name)
        ));
        for (name, figure, words) in figures {
            let number = name.trim_start_matches("figure-");
            let rows: Vec<Vec<String>> = statements
                .iter()
                .filter(|one| one.figure.split(", ").any(|figure| figure == number))
                .map(|one| {
                    vec![
                        format!(
                            "{} <span class=\"soft\">(section {})</span>",
                            escaped(one.stated),
                            one.section
                        ),
                        escaped(&one.made),
                        escaped(one.rule),
                        mark(one.passed),
                    ]
                })
                .collect();
            let _ = write!(
                out,
                "<h2>Figure {number}</h2>{}",
                card(&figure.svg(), &format!("{words} <a href=\"{name}.svg\">{name}.svg</a>"))
            );
            if !rows.is_empty() {
                let _ = write!(
                    out,
                    "<section class=\"card\">{}</section>",
                    table(&["stated", "made", "rule", ""], &rows)
                );
            }
        }
        model_page::page("The paper's figures", &out)
    }
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

fn fly(rig: &Rig, mission: &Mission, seed: u64, file: &Path) -> anyhow::Result<Flight> {
    files::make_room(file, false)?;
    let mut records: Vec<Record> = Vec::new();
    let flown = simulate(rig, mission, seed, &mut records, |_| true)?;
    if flown.ending != Ending::Complete {
        bail!("the flight of {} was stopped: {:?}", mission.name, flown.ending);
    }
    let session = Session {
        rig_name: rig.name.clone(),
        rig_toml: Some(rig.to_toml()),
        mission_name: mission.name.clone(),
        mission_toml: Some(mission.to_toml()),
        seed: Some(seed),
        ..Session::new(Mode::Sim)
    };
    let mut recorder = Recorder::create(file, &session, Options::SIMULATION)?;
    for record in &records {
        recorder.take(*record);
    }
    recorder.finish().with_context(|| format!("cannot record {}", file.display()))?;
    Ok(Flight::from_records(session, records))
}

fn middle(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Altitude as seen, over the time of exposure, s and m.
fn seen(flight: &Flight) -> Vec<(f64, f64)> {
    let found = flight.positions.iter().filter(|p| p.status != TrackStatus::Lost);
    found.map(|p| (p.exposed_at.seconds(), p.position_m[2])).collect()
}

fn true_altitude(flight: &Flight) -> Vec<(f64, f64)> {
    flight.truth.iter().map(|t| (t.time.seconds(), t.position_m[2])).collect()
}

fn true_speed(flight: &Flight) -> Vec<(f64, f64)> {
    flight.truth.iter().map(|t| (t.time.seconds(), t.velocity_m_s[2])).collect()
}

/// Slope of what was seen over 0.2 s, s and m/s.
fn seen_speed(flight: &Flight) -> Vec<(f64, f64)> {
    const HALF_S: f64 = 0.1;
    let z = seen(flight);
    z.iter()
        .filter_map(|(t, _)| {
            let from = z.partition_point(|(time, _)| *time < t - HALF_S - 1e-6);
            let to = z.partition_point(|(time, _)| *time <= t + HALF_S + 1e-6);
            let window = &z[from..to];
            let n = window.len() as f64;
            let mean_t = window.iter().map(|(t, _)| t).sum::<f64>() / n;
            let mean_z = window.iter().map(|(_, z)| z).sum::<f64>() / n;
            let over: f64 = window.iter().map(|(t, z)| (t - mean_t) * (z - mean_z)).sum();
            let under: f64 = window.iter().map(|(t, _)| (t - mean_t).powi(2)).sum();
            (window.len() > 3 && under > 0.0).then(|| (*t, over / under))
        })
        .collect()
}

/// Values over the last 6 s of the hold of a flight.
fn settled(flight: &Flight, values: &[(f64, f64)]) -> Vec<f64> {
    let Some(hold) = flight.phases().into_iter().find(|interval| interval.phase == Phase::Hold) else {
        return Vec::new();
    };
    let to = hold.to.seconds();
    values.iter().filter(|(t, _)| (to - 6.0..to).contains(t)).map(|(_, value)| *value).collect()
}

/// First peak, the trough after it and the peak after that, m; each turn is one of 1 cm at least.
fn rebound(z: &[f64]) -> Option<[f64; 3]> {
    const TURN_M: f64 = 0.01;
    let mut turns = Vec::new();
    let (mut extreme, mut rising) = (0.0_f64, true);
    for z in z {
        let beyond = if rising { *z > extreme } else { *z < extreme };
        if beyond {
            extreme = *z;
        } else if (z - extreme).abs() > TURN_M {
            turns.push(extreme);
            (extreme, rising) = (*z, !rising);
        }
    }
    turns.push(extreme);
    let [peak, trough, again, ..] = turns.as_slice() else { return None };
    Some([*peak, *trough, *again])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rebound_is_a_peak_a_trough_and_a_peak_whatever_the_noise() {
        let hop = [0.0, 0.005, 0.1, 0.2, 0.195, 0.1, 0.02, 0.025, 0.02, 0.05, 0.09, 0.08];
        assert_eq!(rebound(&hop), Some([0.2, 0.02, 0.09]));
        assert_eq!(rebound(&[0.0, 0.1, 0.2, 0.1, 0.0, 0.0]), None);
    }
}

//! Who may command, and what: the rules, without sockets.

use std::{
    collections::BTreeSet,
    time::{Duration, Instant},
};

use bench_rig::{ChangeError, Mission, Phase};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::mpsc;

use crate::{About, Ask, Stage, controls::Commands};

/// START, with what the operator made of the mission.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// The mission to fly.
    pub mission: Mission,
    /// What was changed of it, such as `altitude 0.6 m`.
    pub changes: Vec<String>,
}

/// What the desk tells the command that it belongs to.
#[derive(Debug)]
pub(crate) enum Pressed {
    Start(Box<Start>),
    End,
}

/// Presses that may wait for the command.
const PRESSES: usize = 8;

/// A browser, by the order in which they came.
pub(crate) type Client = u64;

/// What a browser may send once it was let in.
#[derive(Debug, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum Command {
    /// Take the command, if nobody has it.
    Take,
    /// Hand it over: whoever takes it next has it.
    Release,
    /// Fly.
    Start {
        #[serde(default)]
        altitude_m: Option<f64>,
        #[serde(default)]
        flight_time_s: Option<f64>,
    },
    /// Throttle to rest.
    Stop,
    /// Hold this altitude from now on.
    Altitude { altitude_m: f64 },
    /// Go on with the mission's landing.
    Land,
    /// Leave: nobody looks any more.
    End,
    /// Views were drawn: there is room for the next.
    Seen,
}

/// What becomes of a command: words for who gave it.
pub(crate) type Answer = Result<String, String>;

pub(crate) struct Desk {
    about: About,
    stage: Stage,
    commands: Commands,
    clients: BTreeSet<Client>,
    came: Client,
    operator: Option<Client>,
    presses: mpsc::Sender<Pressed>,
    /// Altitude and flight time that are flown, where the operator set them, m and s.
    altitude_m: Option<f64>,
    flight_time_s: Option<f64>,
    /// What the loop said last that it does.
    phase: Option<Phase>,
    /// Whether a landing was asked for.
    lands: bool,
}

impl Desk {
    pub(crate) fn new(about: About, commands: Commands) -> (Self, mpsc::Receiver<Pressed>) {
        let (presses, pressed) = mpsc::channel(PRESSES);
        let desk = Self {
            altitude_m: about.mission.altitude_m().ok(),
            flight_time_s: about
                .mission
                .flight_time_limits_s(&about.rig)
                .is_ok()
                .then(|| about.mission.flight_time_s()),
            about,
            phase: None,
            lands: false,
            stage: Stage::Preparing,
            commands,
            clients: BTreeSet::new(),
            came: 0,
            operator: None,
            presses,
        };
        (desk, pressed)
    }

    /// Somebody with the token came. Whoever finds no operator becomes one.
    pub(crate) fn come(&mut self) -> Client {
        self.came += 1;
        self.clients.insert(self.came);
        self.operator.get_or_insert(self.came);
        self.came
    }

    pub(crate) fn leave(&mut self, client: Client) {
        self.clients.remove(&client);
        self.operator = self.operator.filter(|operator| *operator != client);
    }

    pub(crate) fn clients(&self) -> usize {
        self.clients.len()
    }

    pub(crate) fn stage(&self) -> &Stage {
        &self.stage
    }

    pub(crate) fn set_stage(&mut self, stage: Stage) {
        if matches!(stage, Stage::Waiting { .. }) {
            // Pressed after a START that led to nothing, it is not meant for the next one.
            self.commands.forget_stop();
        }
        self.stage = stage;
    }

    pub(crate) fn set_phase(&mut self, phase: Phase) {
        self.phase = Some(phase);
    }

    /// What every page shows of it.
    pub(crate) fn as_json(&self) -> Value {
        let mut value = json!(self.stage);
        if let Value::Object(value) = &mut value {
            value.insert("type".to_owned(), json!("state"));
            value.insert("operator".to_owned(), json!(self.operator));
            value.insert("clients".to_owned(), json!(self.clients.len()));
            value.insert("altitude_m".to_owned(), json!(self.altitude_m));
            value.insert("flight_time_s".to_owned(), json!(self.flight_time_s));
        }
        value
    }

    pub(crate) fn command(&mut self, client: Client, command: &Command) -> Answer {
        match *command {
            // Anybody who was let in may stop: one look too many costs less than one too few.
            Command::Stop => self.stop(),
            Command::Seen => Ok(String::new()),
            Command::Take => match self.operator {
                Some(operator) if operator != client => Err("somebody else has the command".to_owned()),
                _ => {
                    self.operator = Some(client);
                    Ok("you have the command".to_owned())
                }
            },
            _ if self.operator != Some(client) => Err("only who has the command may do that".to_owned()),
            Command::Release => {
                self.operator = None;
                Ok("whoever takes the command next has it".to_owned())
            }
            Command::Start { altitude_m, flight_time_s } => self.start(altitude_m, flight_time_s),
            Command::Altitude { altitude_m } => self.fly_at(altitude_m),
            Command::Land => self.land(),
            Command::End => match self.stage {
                Stage::Landed(_) | Stage::Waiting { .. } => self.press(Pressed::End, "the bench ends"),
                _ => Err("the bench ends when nothing flies".to_owned()),
            },
        }
    }

    fn stop(&mut self) -> Answer {
        match self.stage {
            Stage::Starting | Stage::Flying => {
                self.commands.stop();
                Ok("STOP: throttle to rest".to_owned())
            }
            _ => Err("nothing flies".to_owned()),
        }
    }

    fn start(&mut self, altitude_m: Option<f64>, flight_time_s: Option<f64>) -> Answer {
        if !matches!(self.stage, Stage::Waiting { .. }) {
            return Err("START is for when all is ready and nothing flies".to_owned());
        }
        let start = self.changed(altitude_m, flight_time_s).map_err(|error| error.to_string())?;
        self.altitude_m = start.mission.altitude_m().ok();
        self.flight_time_s = self.flight_time_s.map(|_| start.mission.flight_time_s());
        let answer = self.press(Pressed::Start(Box::new(start)), "START");
        if answer.is_ok() {
            self.stage = Stage::Starting;
        }
        answer
    }

    /// The mission with what the operator wants of it.
    fn changed(&self, altitude_m: Option<f64>, flight_time_s: Option<f64>) -> Result<Start, ChangeError> {
        let (rig, mut mission, mut changes) = (&self.about.rig, self.about.mission.clone(), Vec::new());
        if let Some(altitude_m) = altitude_m.filter(|wanted_m| mission.altitude_m().as_ref() != Ok(wanted_m))
        {
            mission = mission.at_altitude(altitude_m, rig)?;
            changes.push(format!("altitude {altitude_m} m"));
        }
        if let Some(flight_time_s) = flight_time_s.filter(|wanted_s| mission.flight_time_s() != *wanted_s) {
            mission = mission.with_flight_time(flight_time_s, rig)?;
            changes.push(format!("flight time {flight_time_s} s"));
        }
        Ok(Start { mission, changes })
    }

    fn fly_at(&mut self, altitude_m: f64) -> Answer {
        if self.stage != Stage::Flying {
            return Err(
                "an altitude is for a flight that is under way; before it, set it and press START".to_owned()
            );
        }
        let [low_m, high_m] = self.about.rig.altitude_envelope_m();
        if !(low_m..=high_m).contains(&altitude_m) {
            return Err(format!("{altitude_m} m is outside of the rig's {low_m:.2} to {high_m:.2} m"));
        }
        if self.is_landing() {
            return Err("it is landing".to_owned());
        }
        self.ask(Ask::Altitude(altitude_m))?;
        self.altitude_m = Some(altitude_m);
        Ok(format!("holding {altitude_m:.2} m from now on"))
    }

    fn land(&mut self) -> Answer {
        if self.stage != Stage::Flying {
            return Err("LAND is for a flight that is under way".to_owned());
        }
        if self.is_landing() {
            return Ok("it is landing already".to_owned());
        }
        if !self.about.mission.phases.iter().any(|plan| plan.action.phase() == Phase::Land) {
            return Err("this mission has no landing; STOP sends the throttle to rest".to_owned());
        }
        self.ask(Ask::Land)?;
        self.lands = true;
        Ok("LAND: on to the mission's landing".to_owned())
    }

    fn is_landing(&self) -> bool {
        self.lands || self.phase == Some(Phase::Land)
    }

    fn ask(&mut self, ask: Ask) -> Result<(), String> {
        if self.commands.ask(ask) {
            Ok(())
        } else {
            Err("the loop has not taken what was asked for before; try again".to_owned())
        }
    }

    fn press(&self, pressed: Pressed, words: &str) -> Answer {
        match self.presses.try_send(pressed) {
            Ok(()) => Ok(words.to_owned()),
            Err(_) => Err("the bench is busy; try again".to_owned()),
        }
    }
}

/// How many commands a browser may give in a burst, and how many a second after that.
const BURST: f64 = 6.0;
const PER_S: f64 = 4.0;

/// The rate of a browser's commands, as a bucket of tokens.
pub(crate) struct Rate {
    tokens: f64,
    at: Instant,
}

impl Rate {
    pub(crate) fn new(now: Instant) -> Self {
        Self { tokens: BURST, at: now }
    }

    /// Whether one more command is within the rate.
    pub(crate) fn allows(&mut self, now: Instant) -> bool {
        let since: Duration = now.saturating_duration_since(self.at);
        self.at = now;
        self.tokens = (self.tokens + PER_S * since.as_secs_f64()).min(BURST);
        let allowed = self.tokens >= 1.0;
        if allowed {
            self.tokens -= 1.0;
        }
        allowed
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_rig::Rig;

    use super::*;
    use crate::{
        Outcome,
        controls::{self, Ask, Controls},
    };

    fn desk_for(mission: &str) -> (Desk, Controls, mpsc::Receiver<Pressed>) {
        let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
        let about = About {
            mode: "sim",
            rig: Rig::load(rigs.join("virtual.toml")).unwrap(),
            mission: Mission::load(rigs.join("missions").join(mission)).unwrap(),
            real_time: true,
            views: false,
            truth: true,
        };
        let (commands, controls) = controls::channel();
        let (desk, pressed) = Desk::new(about, commands);
        (desk, controls, pressed)
    }

    fn start(altitude_m: Option<f64>, flight_time_s: Option<f64>) -> Command {
        Command::Start { altitude_m, flight_time_s }
    }

    #[test]
    fn the_first_commands_until_it_hands_over_or_leaves() {
        let (mut desk, _controls, _pressed) = desk_for("climb-040.toml");
        let [first, second] = [desk.come(), desk.come()];
        desk.set_stage(Stage::Waiting { checked: Vec::new(), warning: None });
        assert!(desk.command(second, &start(None, None)).is_err());
        assert!(desk.command(second, &Command::Take).is_err());
        assert!(desk.command(second, &Command::Release).is_err());
        assert!(desk.command(first, &Command::Release).is_ok());
        assert!(desk.command(first, &start(None, None)).is_err(), "nobody has the command");
        assert!(desk.command(second, &Command::Take).is_ok());
        desk.leave(second);
        assert_eq!(desk.as_json()["operator"], Value::Null);
        let third = desk.come();
        assert_eq!(desk.as_json()["operator"], third);
        assert!(desk.command(third, &start(None, None)).is_ok());
    }

    #[test]
    fn a_stop_after_a_start_that_led_to_nothing_does_not_end_the_next_one() {
        let (mut desk, mut controls, mut pressed) = desk_for("climb-040.toml");
        let client = desk.come();
        let waiting = || Stage::Waiting { checked: Vec::new(), warning: None };
        desk.set_stage(waiting());
        for _ in 0..2 {
            desk.command(client, &start(None, None)).unwrap();
            assert!(matches!(pressed.try_recv(), Ok(Pressed::Start(_))));
            assert_eq!(controls.next_ask(), None);
            // The loop has given up, and the page is not yet told to wait.
            desk.command(client, &Command::Stop).unwrap();
            assert_eq!(controls.next_ask(), Some(Ask::Stop));
            desk.set_stage(waiting());
        }
    }

    #[test]
    fn start_changes_the_mission_and_says_what_cannot_be_changed() {
        let (mut desk, _controls, mut pressed) = desk_for("climb-040.toml");
        let client = desk.come();
        assert!(desk.command(client, &start(None, None)).is_err(), "devices are not ready");
        desk.set_stage(Stage::Waiting { checked: Vec::new(), warning: None });
        let too_high = desk.command(client, &start(Some(1.9), None)).unwrap_err();
        assert!(too_high.contains("1.9 m") && too_high.contains("0.05 to 1.60 m"), "{too_high}");
        let too_short = desk.command(client, &start(None, Some(1.0))).unwrap_err();
        assert!(too_short.contains("1.7 to 294.0 s"), "{too_short}");
        assert!(desk.command(client, &start(Some(f64::NAN), None)).is_err());
        desk.command(client, &start(Some(0.6), Some(10.0))).unwrap();
        let Ok(Pressed::Start(start_)) = pressed.try_recv() else { panic!("nothing was started") };
        assert_eq!(start_.changes, ["altitude 0.6 m", "flight time 10 s"]);
        assert_eq!(start_.mission.altitude_m(), Ok(0.6));
        assert!((start_.mission.flight_time_s() - 10.0).abs() < 1e-12);
        assert!((start_.mission.criteria.peak_min_m.unwrap() - 0.6).abs() < 1e-12);
        assert!(desk.command(client, &start(None, None)).is_err(), "it is under way");

        for (mission, words) in [("steps.toml", "holds one altitude"), ("hop.toml", "holds no altitude")] {
            let (mut desk, _controls, _pressed) = desk_for(mission);
            let client = desk.come();
            desk.set_stage(Stage::Waiting { checked: Vec::new(), warning: None });
            let refused = desk.command(client, &start(Some(0.6), None)).unwrap_err();
            assert!(refused.contains(words), "{refused}");
            assert!(desk.command(client, &start(None, None)).is_ok(), "as it stands it can be flown");
        }
    }

    #[test]
    fn anybody_stops_and_only_the_operator_sets_altitudes_within_the_envelope() {
        let (mut desk, mut controls, _pressed) = desk_for("climb-040.toml");
        let [first, second] = [desk.come(), desk.come()];
        let altitude = |altitude_m| Command::Altitude { altitude_m };
        assert!(desk.command(first, &altitude(0.6)).is_err(), "nothing flies");
        assert!(desk.command(first, &Command::Stop).is_err(), "nothing flies");
        desk.set_stage(Stage::Flying);
        assert!(desk.command(second, &altitude(0.6)).is_err());
        for outside_m in [0.0, 1.7, -1.0, f64::NAN, f64::INFINITY] {
            assert!(desk.command(first, &altitude(outside_m)).is_err(), "{outside_m}");
        }
        assert_eq!(controls.next_ask(), None);
        desk.command(first, &altitude(0.6)).unwrap();
        assert_eq!(controls.next_ask(), Some(Ask::Altitude(0.6)));
        let taken = (0..20).filter(|_| desk.command(first, &altitude(0.5)).is_ok()).count();
        assert_eq!(taken, 16, "the queue is bounded");
        desk.command(second, &Command::Stop).unwrap();
        assert_eq!(
            [controls.next_ask(), controls.next_ask()],
            [Some(Ask::Stop); 2],
            "STOP comes first, and stays"
        );
        desk.set_stage(Stage::Landed(Outcome::default()));
        assert!(desk.command(second, &Command::End).is_err());
        assert!(desk.command(first, &Command::End).is_ok());
    }

    #[test]
    fn the_operator_has_it_land_and_a_second_press_is_answered_kindly() {
        let (mut desk, mut controls, _pressed) = desk_for("climb-040.toml");
        let [first, second] = [desk.come(), desk.come()];
        assert!(desk.command(first, &Command::Land).is_err(), "nothing flies");
        desk.set_stage(Stage::Flying);
        desk.set_phase(Phase::Hold);
        assert!(desk.command(second, &Command::Land).is_err(), "it has not the command");
        assert_eq!(controls.next_ask(), None);
        desk.command(first, &Command::Altitude { altitude_m: 0.6 }).unwrap();
        assert!(desk.command(first, &Command::Land).unwrap().starts_with("LAND"));
        assert_eq!(
            [controls.next_ask(), controls.next_ask()],
            [Some(Ask::Altitude(0.6)), Some(Ask::Land)],
            "in their order"
        );
        assert_eq!(desk.command(first, &Command::Land).unwrap(), "it is landing already");
        let refused = desk.command(first, &Command::Altitude { altitude_m: 0.5 }).unwrap_err();
        assert!(refused.contains("landing"), "{refused}");
        assert_eq!(controls.next_ask(), None);

        // By itself, too.
        let (mut desk, mut controls, _pressed) = desk_for("climb-040.toml");
        let client = desk.come();
        desk.set_stage(Stage::Flying);
        desk.set_phase(Phase::Land);
        assert_eq!(desk.command(client, &Command::Land).unwrap(), "it is landing already");
        assert_eq!(controls.next_ask(), None);

        let (mut desk, mut controls, _pressed) = desk_for("hop.toml");
        let client = desk.come();
        desk.set_stage(Stage::Flying);
        let refused = desk.command(client, &Command::Land).unwrap_err();
        assert!(refused.contains("no landing") && refused.contains("STOP"), "{refused}");
        assert_eq!(controls.next_ask(), None);
    }

    #[test]
    fn commands_are_limited_in_rate_and_the_rate_comes_back() {
        let began = Instant::now();
        let mut rate = Rate::new(began);
        let allowed = (0..20).filter(|_| rate.allows(began)).count();
        assert_eq!(allowed, 6);
        assert!(rate.allows(began + Duration::from_millis(250)));
        assert!(!rate.allows(began + Duration::from_millis(300)));
        let later = began + Duration::from_secs(60);
        assert_eq!((0..20).filter(|_| rate.allows(later)).count(), 6);
    }

    #[test]
    fn what_is_no_command_is_refused_by_its_form() {
        for text in [
            r#"{"command":"fly"}"#,
            r#"{"command":"altitude"}"#,
            r#"{"command":"altitude","altitude_m":"high"}"#,
            "stop",
            "",
        ] {
            assert!(serde_json::from_str::<Command>(text).is_err(), "{text}");
        }
        let set: Command = serde_json::from_str(r#"{"command":"altitude","altitude_m":0.5}"#).unwrap();
        assert!(matches!(set, Command::Altitude { altitude_m } if altitude_m == 0.5));
    }
}

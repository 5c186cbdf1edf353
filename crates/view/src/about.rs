use bench_rig::{Mission, Rig};
use serde::Serialize;
use serde_json::{Value, json};

/// What the page is told before anything flies.
#[derive(Clone, Debug)]
pub struct About {
    /// `sim` or `hil`.
    pub mode: &'static str,
    /// The rig that the controller believes in.
    pub rig: Rig,
    /// The mission as it stands before the operator changes it.
    pub mission: Mission,
    /// Whether time is the wall clock's.
    pub real_time: bool,
    /// Whether there are frames to show.
    pub views: bool,
    /// Whether the true state is known.
    pub truth: bool,
}

/// Where the bench is.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "stage", rename_all = "lowercase")]
pub enum Stage {
    /// Devices are connected and checked.
    Preparing,
    /// All is ready; START is waited for.
    Waiting {
        /// What was checked, a line each.
        checked: Vec<String>,
        /// Why the START before this one did not lead to a flight.
        warning: Option<String>,
    },
    /// START was pressed, or is not waited for; the marker is looked for and outputs are armed.
    Starting,
    /// In flight.
    Flying,
    /// The flight is over; the page stays.
    Landed(Outcome),
    /// The bench ends, and its page with it.
    Closed(Outcome),
}

/// How a flight ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Whether it ended as the mission wants it.
    pub passed: bool,
    /// In a sentence.
    pub headline: String,
    /// What the terminal says of it.
    pub words: String,
}

impl About {
    pub(crate) fn as_json(&self) -> Value {
        let Self { mode, rig, mission, real_time, views, truth } = self;
        let altitude_m = mission.altitude_m();
        let limits_s = mission.flight_time_limits_s(rig);
        let sticks = &rig.airframe.sticks;
        let why = altitude_m.as_ref().err().map(ToString::to_string);
        json!({
            "mode": mode, "real_time": real_time, "views": views, "truth": truth,
            "rig": rig.name, "airframe": rig.airframe.name,
            "mission": mission.name, "description": mission.description,
            "phases": mission.phases.iter().map(|plan| json!([plan.action.phase().name(), plan.duration_s])).collect::<Vec<_>>(),
            "duration_s": mission.duration_s(),
            "altitude_m": altitude_m.ok(), "altitude_fixed": why,
            "flight_time_s": limits_s.is_ok().then(|| mission.flight_time_s()),
            "flight_time_limits_s": limits_s.ok(),
            "envelope_m": rig.altitude_envelope_m(),
            "ceiling_m": rig.safety.ceiling_m, "radius_m": rig.safety.radius_m,
            "ground_effect_m": rig.airframe.ground_effect.height_m.value,
            "period_s": rig.control_loop.period_s,
            "unit": rig.airframe.actuation.unit(), "sticks": [sticks.min, sticks.max],
            "camera": rig.calibration.as_ref().map(|seen| json!({
                "position_m": seen.camera_position_m, "attitude_rad": seen.camera_attitude_rad,
            })),
            "version": env!("CARGO_PKG_VERSION"),
        })
    }
}

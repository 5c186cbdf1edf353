//! Records and recordings that tests share.

#![allow(dead_code, reason = "each test binary uses its part")]

use std::path::{Path, PathBuf};

use bench_device::{Faults, PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_recording::{
    Battery, Command, ControlState, Event, EventText, Finished, Level, Mode, Motion, Options, ReadbackAt,
    Record, Recorder, Rotor, Session, Tick, Truth,
};
use bench_rig::Phase;

/// A simulated session with everything in it.
pub fn session() -> Session {
    Session {
        rig_name: "virtual".into(),
        rig_toml: Some("name = \"virtual\"\n".into()),
        mission_name: "hop".into(),
        mission_toml: Some("name = \"hop\"\n".into()),
        seed: Some(7),
        extra: [("note".to_owned(), "ä test".to_owned())].into(),
        ..Session::new(Mode::Sim)
    }
}

/// One record of every kind at `t_s`, all numbers distinct and different at each time.
pub fn one_of_each(t_s: f64) -> [Record; 10] {
    let time = Time::from_seconds(t_s);
    let sticks = |offset: f64| Sticks {
        throttle: 1.9 + offset + t_s,
        pitch: -0.25 + offset,
        roll: 1.5 + offset,
        yaw: 1.65,
    };
    [
        PositionSample {
            exposed_at: time.shifted(-0.3),
            arrived_at: time,
            position_m: [0.01, -0.02, 0.4 + t_s],
            heading_rad: Some(-0.1),
            pixel: [320.5, 240.25],
            size_px: 12.5,
            status: TrackStatus::Ambiguous,
        }
        .into(),
        Motion {
            time,
            velocity_m_s: [Some(0.1), None, Some(-0.3)],
            vertical_acceleration_m_s2: Some(0.0),
            attitude_rad: [None, Some(0.02), Some(t_s)],
        }
        .into(),
        ControlState {
            time,
            phase: Phase::Hold,
            setpoint_m: [0.0, 0.1, 0.4],
            setpoint_heading_rad: 0.2,
            estimate_m: [0.01, 0.11, 0.39],
            estimate_m_s: [0.001, -0.002, 0.003],
            vertical_speed_setpoint_m_s: 0.0055,
            vertical_speed_error_m_s: 0.0025,
            integral_n: 0.147,
            thrust_n: 0.15 + t_s,
        }
        .into(),
        Command { time, sticks: sticks(0.0) }.into(),
        ReadbackAt {
            time,
            readback: Readback {
                device_time: time.shifted(0.001),
                sticks: sticks(0.01),
                faults: Faults { clamped: true, brown_out: true, ..Faults::default() },
            },
        }
        .into(),
        Truth {
            time,
            position_m: [0.02, -0.01, 0.41 + t_s],
            velocity_m_s: [0.1, 0.2, 0.3],
            attitude: [0.99, 0.01, 0.02, 0.03],
            body_rate_rad_s: [1.0, 2.0, 3.0],
            thrust_n: 0.148,
            rotor_speed_ratio: 1.01,
            charge_hover_min: t_s / 60.0,
        }
        .into(),
        Tick {
            index: (t_s * 10.0).round() as u64,
            scheduled: time.shifted(-0.000_05),
            started: time,
            sense_s: 0.000_1,
            control_s: 0.000_02,
            actuate_s: 0.002,
            overrun: t_s > 1.0,
        }
        .into(),
        Event {
            time, level: Level::Warning, text: EventText::from("tracker lost the marker — ü").unwrap()
        }
        .into(),
        Battery { time, voltage_v: 3.71 - t_s / 100.0, current_a: None }.into(),
        Rotor { time, speed_rad_s: [Some(900.0 + t_s), Some(901.0), None, Some(903.0)] }.into(),
    ]
}

/// `seconds` of flight: a simulation's mix of channels, with a tick each 0.1 s and truth each 0.02 s.
pub fn flight(seconds: f64) -> Vec<Record> {
    let mut records = Vec::new();
    for step in 0..(seconds * 50.0).round() as u64 {
        let t_s = step as f64 * 0.02;
        let [position, _, state, command, readback, truth, tick, event, battery, rotor] = one_of_each(t_s);
        records.push(truth);
        if step % 2 == 0 {
            records.push(position);
        }
        if step % 5 == 0 {
            records.extend([state, command, readback, tick]);
        }
        if step % 50 == 0 {
            records.extend([event, battery, rotor]);
        }
    }
    records
}

/// Records into a file in `folder`.
pub fn write(folder: &Path, name: &str, session: &Session, records: &[Record]) -> (PathBuf, Finished) {
    let path = folder.join(name);
    // Short chunks, so that a short recording has several.
    let options = Options { flush_interval_s: 0.5, ..Options::SIMULATION };
    let mut recorder = Recorder::create(&path, session, options).unwrap();
    for record in records {
        recorder.record(*record);
    }
    let finished = recorder.finish().unwrap();
    (path, finished)
}

//! Logs of autopilots, as they are: a flight of the virtual airframe written in each format with that format's conventions.

use std::{collections::BTreeMap, fs, io::Cursor};

use bench_device::PositionSample;
use bench_recording::Flight;
use serde_json::Value;

use crate::support::{Scratch, bench, json, refused, root, stdout};

#[path = "../../crates/logs/tests/logs/writers.rs"]
#[allow(dead_code, reason = "the tests of the readers use all of it")]
pub mod writers;

use writers::{Blackbox, Crazyflie, Dataflash, Packed, Ulog, floats};

/// How long the autopilot was on before the flight, us.
const BOOT_US: u64 = 100_000_000;

/// The virtual rig with sticks in fractions of their range, as autopilots log them.
pub fn rig(scratch: &Scratch) -> String {
    let read = |name: &str| fs::read_to_string(root().join("rigs").join(name)).unwrap();
    let mut airframe: toml::Table = read("airframes/hubsan-q4.toml").parse().unwrap();
    airframe["actuation"] = "fraction".into();
    let volts = 3.3;
    for table in ["thrust", "sticks"] {
        let keys = airframe[table].as_table_mut().unwrap();
        for (key, factor) in [
            ("gain_n_per", volts),
            ("offset", 1.0 / volts),
            ("min", 1.0 / volts),
            ("max", 1.0 / volts),
            ("centre", 1.0 / volts),
            ("tilt_rad_per", volts),
            ("yaw_rate_rad_s_per", volts),
        ] {
            let Some(mut value) = keys.remove(&format!("{key}_v")) else { continue };
            match &mut value {
                toml::Value::Float(number) => *number *= factor,
                toml::Value::Table(uncertain) => {
                    for name in ["value", "sigma"] {
                        uncertain[name] = (uncertain[name].as_float().unwrap() * factor).into();
                    }
                }
                other => panic!("{other}"),
            }
            keys.insert(format!("{key}_fraction"), value);
        }
    }
    fs::write(scratch.path("quad.toml"), airframe.to_string()).unwrap();
    let rig = read("virtual.toml").replace("airframes/hubsan-q4.toml", "quad.toml");
    fs::write(scratch.path("rig.toml"), rig.replace("six-degree", "vertical")).unwrap();
    scratch.name("rig.toml")
}

fn micros(time: bench_device::Time) -> u64 {
    BOOT_US + time.nanos() / 1000
}

/// What both autopilots say of a position, in their axes: north, east, down.
fn ned(position: &PositionSample) -> [f64; 3] {
    let [x, y, z] = position.position_m;
    [x, -y, -z]
}

fn seen(flight: &Flight) -> impl Iterator<Item = &PositionSample> {
    flight.positions.iter().filter(|position| position.status == bench_device::TrackStatus::Found)
}

/// As PX4 logs it: times in us, north-east-down, thrust from 0 to -1.
pub fn px4(flight: &Flight) -> Vec<u8> {
    let mut log = Ulog::new();
    log.info("sys_name", "PX4");
    log.parameter("MPC_THR_HOVER", 0.5);
    log.format(
        "vehicle_visual_odometry:uint64_t timestamp;uint64_t timestamp_sample;float[3] position;float[4] q;",
    );
    log.format("vehicle_thrust_setpoint:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;");
    log.format("sensor_baro:uint64_t timestamp;float pressure;");
    log.subscribe(0, 0, "vehicle_visual_odometry");
    log.subscribe(1, 0, "vehicle_thrust_setpoint");
    log.subscribe(2, 0, "sensor_baro");
    log.data(2, BOOT_US - 5_000_000, &floats(&[101_325.0]));
    log.dropout(20);
    for position in seen(flight) {
        let exposed = micros(position.exposed_at).to_le_bytes();
        let half = -0.5 * position.heading_rad.unwrap_or(0.0);
        let pose = [&ned(position)[..], &[half.cos(), 0.0, 0.0, half.sin()]].concat();
        log.data(0, micros(position.arrived_at), &[&exposed[..], &floats(&pose)].concat());
    }
    // A logger writes topic by topic, not in the order of times; within a second.
    let mut bytes = log.bytes();
    let mut commands = Ulog::new();
    for command in &flight.commands {
        let time = micros(command.time);
        let thrust = floats(&[0.0, 0.0, -command.sticks.throttle]);
        commands.data(1, time, &[&time.to_le_bytes()[..], &thrust].concat());
    }
    let commands = commands.bytes().split_off(16 + 43);
    interleave(&mut bytes, &commands);
    bytes
}

/// Brings the messages of a second log among those of the first, by their stamps.
fn interleave(bytes: &mut Vec<u8>, more: &[u8]) {
    let split = |bytes: &[u8], from: usize| {
        let mut at = from;
        let mut messages = Vec::new();
        while at < bytes.len() {
            let length = 3 + usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
            messages.push(bytes[at..at + length].to_vec());
            at += length;
        }
        messages
    };
    let stamp = |message: &Vec<u8>| match message[2] {
        b'D' => u64::from_le_bytes(message[5..13].try_into().unwrap()),
        _ => 0,
    };
    let mut messages = split(bytes, 16);
    messages.extend(split(more, 0));
    messages.sort_by_key(stamp);
    bytes.truncate(16);
    bytes.extend(messages.concat());
}

/// As `ArduPilot` logs it: exposures in whole milliseconds, north-east-down, throttle from 0 to 1.
fn ardupilot(flight: &Flight) -> Vec<u8> {
    let mut log = Dataflash::new();
    log.format(80, "VISP", "QQIffffffffBBb", "TimeUS,RTimeUS,CTimeMS,PX,PY,PZ,R,P,Y,PErr,AErr,Rst,Ign,Q");
    log.format(81, "CTUN", "Qffffffefffhh", "TimeUS,ThI,ABst,ThO,ThH,DAlt,Alt,BAlt,DSAlt,SAlt,TAlt,DCRt,CRt");
    let mut messages = Vec::new();
    for position in seen(flight) {
        let exposed = micros(position.exposed_at);
        let head =
            [&exposed.to_le_bytes()[..], &((exposed as f64 / 1000.0).round() as u32).to_le_bytes()].concat();
        let [north, east, down] = ned(position);
        let values = floats(&[north, east, down, 0.0, 0.0, 0.0, 0.01, 0.01]);
        messages.push((micros(position.arrived_at), 80, [head, values, vec![0, 0, 100]].concat()));
    }
    for command in &flight.commands {
        let before = floats(&[0.0, 0.0, command.sticks.throttle, 0.4, 0.5, 0.0]);
        let after = [0_i32.to_le_bytes().to_vec(), floats(&[0.0; 3]), vec![0; 4]].concat();
        messages.push((micros(command.time), 81, [before, after].concat()));
    }
    messages.sort_by_key(|(time, ..)| *time);
    for (time, kind, values) in messages {
        log.data(kind, time, &values);
    }
    log.bytes()
}

/// Times, ns, and content.
type Messages = Vec<(u64, Vec<u8>)>;

/// A bag of ROS 2 in MCAP.
struct Bag {
    bytes: Vec<u8>,
    /// Type, topic, and the messages.
    topics: Vec<(&'static str, String, Messages)>,
}

/// Definitions of messages as bags carry them, by type.
const DEFINITIONS: [(&str, &str); 5] = [
    (
        "geometry_msgs/msg/PoseStamped",
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n=====\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "nav_msgs/msg/Odometry",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n=====\nMSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance\n=====\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "mavros_msgs/msg/AttitudeTarget",
        "std_msgs/Header header\nuint8 type_mask\ngeometry_msgs/Quaternion orientation\ngeometry_msgs/Vector3 body_rate\nfloat32 thrust\n",
    ),
    (
        "px4_msgs/msg/VehicleLocalPosition",
        "uint64 timestamp\nuint64 timestamp_sample\nbool xy_valid\nfloat32 x\nfloat32 y\nfloat32 z\n",
    ),
    ("px4_msgs/msg/VehicleThrustSetpoint", "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\n"),
];
const SHARED: &str = "=====\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n=====\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n\
    =====\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n=====\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

/// A message in CDR: each number stands at a multiple of its size.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn number(mut self, bytes: &[u8]) -> Self {
        while !(self.0.len() - 4).is_multiple_of(bytes.len()) {
            self.0.push(0);
        }
        self.0.extend(bytes);
        self
    }

    fn text(self, text: &str) -> Self {
        let mut with_length = self.number(&(text.len() as u32 + 1).to_le_bytes());
        with_length.0.extend(text.bytes().chain([0]));
        with_length
    }

    fn header(self, nanos: u64) -> Self {
        let (seconds, rest) = ((nanos / 1_000_000_000) as u32, (nanos % 1_000_000_000) as u32);
        self.number(&seconds.to_le_bytes()).number(&rest.to_le_bytes()).text("map")
    }

    fn doubles(self, numbers: &[f64]) -> Self {
        numbers.iter().fold(self, |message, number| message.number(&number.to_le_bytes()))
    }

    fn singles(self, numbers: &[f64]) -> Self {
        numbers.iter().fold(self, |message, number| message.number(&(*number as f32).to_le_bytes()))
    }
}

impl Bag {
    fn new() -> Self {
        Self { bytes: Vec::new(), topics: Vec::new() }
    }

    fn topic(&mut self, kind: &'static str, name: &str, messages: impl Iterator<Item = (u64, Cdr)>) {
        let messages = messages.map(|(nanos, message)| (nanos, message.0)).collect();
        self.topics.push((kind, name.to_owned(), messages));
    }

    fn bytes(mut self) -> Vec<u8> {
        let mut writer = mcap::WriteOptions::new()
            .profile("ros2")
            .compression(None)
            .create(Cursor::new(&mut self.bytes))
            .unwrap();
        let mut all = Vec::new();
        for (kind, name, messages) in self.topics {
            let (_, definition) = DEFINITIONS.iter().find(|(known, _)| *known == kind).unwrap();
            let schema =
                writer.add_schema(kind, "ros2msg", format!("{definition}{SHARED}").as_bytes()).unwrap();
            let channel = writer.add_channel(schema, &name, "cdr", &BTreeMap::new()).unwrap();
            all.extend(messages.into_iter().map(|(nanos, message)| (nanos, channel, message)));
        }
        all.sort_by_key(|(nanos, ..)| *nanos);
        for (nanos, channel_id, message) in all {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time: nanos,
                publish_time: nanos,
            };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        self.bytes
    }
}

/// When a bag began, ns since 1970.
const BAG_NS: u64 = 1_750_000_000_000_000_000;

fn pose(nanos: u64, [x, y, z]: [f64; 3], heading_rad: f64) -> Cdr {
    let half = 0.5 * heading_rad;
    Cdr::new().header(nanos).doubles(&[x, y, z, 0.0, 0.0, half.sin(), half.cos()])
}

/// As MAVROS publishes it: east-north-up, a pose when it came, thrust from 0 to 1.
fn mavros(flight: &Flight) -> Vec<u8> {
    let mut bag = Bag::new();
    let arrived = |time: bench_device::Time| BAG_NS + time.nanos();
    let poses = seen(flight).map(|position| {
        let nanos = arrived(position.arrived_at);
        (nanos, pose(nanos, position.position_m, position.heading_rad.unwrap_or(0.0)))
    });
    bag.topic("geometry_msgs/msg/PoseStamped", "/mavros/local_position/pose", poses);
    let thrusts = flight.commands.iter().map(|command| {
        let nanos = arrived(command.time);
        let before = Cdr::new().header(nanos).number(&[7]).doubles(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        (nanos, before.singles(&[command.sticks.throttle]))
    });
    bag.topic("mavros_msgs/msg/AttitudeTarget", "/mavros/setpoint_raw/target_attitude", thrusts);
    bag.bytes()
}

#[test]
fn a_bag_of_ros_2_finds_its_map_and_two_vehicles_in_one_are_told() {
    let scratch = Scratch::new();
    let out = scratch.name("bag.mcap");
    let imported = |name: &str, bag: Bag| {
        fs::write(scratch.path(name), bag.bytes()).unwrap();
        bench(["import", &scratch.name(name), "-o", &out, "--force", "--json"])
    };
    let at = |k: u64| BAG_NS + k * 20_000_000;
    // PX4's own messages, whatever their topics are called.
    let mut bag = Bag::new();
    let places = (0..100).map(|k| {
        let stamps = Cdr::new().number(&5_u64.to_le_bytes()).number(&4_u64.to_le_bytes()).number(&[1]);
        (at(k), stamps.singles(&[1.0, 2.0, -0.01 * k as f64]))
    });
    bag.topic("px4_msgs/msg/VehicleLocalPosition", "/fmu/out/vehicle_local_position_v1", places);
    let thrusts = (0..100).map(|k| {
        let stamps = Cdr::new().number(&5_u64.to_le_bytes()).number(&4_u64.to_le_bytes());
        (at(k) + 1000, stamps.singles(&[0.0, 0.0, -0.5]))
    });
    bag.topic("px4_msgs/msg/VehicleThrustSetpoint", "/drone/fmu/in/vehicle_thrust_setpoint", thrusts);
    let report = json(&imported("px4.mcap", bag).assert().success());
    assert_eq!((&report["map"], &report["skipped"]), (&"ros2-px4".into(), &Value::Array(Vec::new())));
    let flight = Flight::load(&out).unwrap();
    let (position, command) = (flight.positions.last().unwrap(), flight.commands.last().unwrap());
    assert!((position.position_m[2] - 0.99).abs() < 1e-7 && position.position_m[1] == -2.0, "{position:?}");
    assert_eq!((flight.positions.len(), flight.commands.len(), command.sticks.throttle), (100, 100, 0.5));
    // Odometry alone, of one vehicle and of two.
    let odometry = |bag: &mut Bag, name: &str| {
        let places = (0..50).map(|k| {
            let message = Cdr::new().header(at(k)).text("base_link");
            (at(k), message.doubles(&[0.0, 0.5, 0.02 * k as f64, 0.0, 0.0, 0.0, 1.0]).doubles(&[0.1; 36]))
        });
        bag.topic("nav_msgs/msg/Odometry", name, places);
    };
    let mut bag = Bag::new();
    odometry(&mut bag, "/uav1/odom");
    let report = json(&imported("odometry.mcap", bag).assert().success());
    assert_eq!((&report["map"], &report["topics"]["has_throttle"]), (&"ros2-odometry".into(), &false.into()));
    let mut bag = Bag::new();
    odometry(&mut bag, "/uav1/odom");
    odometry(&mut bag, "/uav2/odom");
    let words = refused(imported("two.mcap", bag), 2);
    assert!(words.contains("/uav1/odom, /uav2/odom") && words.contains("Copy the map"), "{words}");
    // A motion capture without thrust, and a bag of something else.
    let mut bag = Bag::new();
    let poses = (0..50).map(|k| (at(k), pose(at(k), [0.0, 0.0, 0.3], 0.5)));
    bag.topic("geometry_msgs/msg/PoseStamped", "/vicon/quad", poses);
    assert_eq!(json(&imported("pose.mcap", bag).assert().success())["map"], "ros2-pose");
    let words = refused(imported("empty.mcap", Bag::new()), 2);
    assert!(words.contains("no altitude"), "{words}");
    // What the bench recorded itself needs no import.
    let words = refused(bench(["import", &out, "-o", &scratch.name("again.mcap")]), 2);
    assert!(words.contains("needs no import"), "{words}");
}

#[test]
fn a_file_that_is_no_log_is_answered_with_what_is_read() {
    let scratch = Scratch::new();
    fs::write(scratch.path("garbage.bin"), [0xff, 0xfe, 0, 1, 2, 3]).unwrap();
    for more in [&[][..], &["--map", "crazypad"]] {
        let fixed = ["import", &scratch.name("garbage.bin"), "-o", &scratch.name("out.mcap")];
        let words = refused(bench(fixed.iter().chain(more)), 2);
        for format in ["PX4 (ULog)", "ArduPilot (dataflash)", "bags of ROS 2", "Parquet", "(CSV)"] {
            assert!(words.contains(format), "{format}: {words}");
        }
    }
}

const MISSIONS: [&str; 3] = ["hop", "climb-040", "low-hover"];

fn diagnosed(recordings: &[String], rig: &str) -> Value {
    let arguments = ["diagnose", "--rig", rig, "--json"].map(str::to_owned);
    json(&bench(arguments.iter().chain(recordings)).assert().code(vec![0, 1]))
}

#[test]
fn the_same_flights_by_each_format_have_the_same_diagnosis() {
    let scratch = Scratch::new();
    let rig = rig(&scratch);
    let flown: Vec<String> = MISSIONS
        .iter()
        .map(|mission| {
            let out = scratch.name(&format!("{mission}.mcap"));
            let effect = "battery-discharge:loss_per_hover_minute=0.05";
            bench(["sim", "--rig", &rig, "--mission", mission, "--effect", effect, "-o", &out])
                .assert()
                .code(vec![0, 1, 4]);
            out
        })
        .collect();
    let imported = |format: &str, log: &dyn Fn(&str) -> (String, Vec<String>)| -> Vec<String> {
        flown
            .iter()
            .map(|recording| {
                let (file, more) = log(recording);
                let out = recording.replace(".mcap", &format!("-{format}.mcap"));
                let fixed = ["import", &file, "--rig", &rig, "-o", &out, "--json"].map(str::to_owned);
                let report = json(&bench(fixed.iter().chain(&more)).assert().success());
                assert_eq!(
                    (&report["skipped"], &report["used"]),
                    (&Value::Array(Vec::new()), &report["rows"])
                );
                out
            })
            .collect()
    };
    let written = |recording: &str, ending: &str, write: &dyn Fn(&Flight) -> Vec<u8>| {
        let file = recording.replace("mcap", ending);
        fs::write(&file, write(&Flight::load(recording).unwrap())).unwrap();
        (file, Vec::new())
    };
    let map = scratch.name("map.toml");
    let mcap = "name = \"own\"\nlog = \"mcap\"\nactuation = \"fraction\"\n\
        [position]\nexposed_at = { column = \"/tracker/position.exposed_at_ns\", unit = \"ns\" }\n\
        x = { column = \"/tracker/position.position_m.x\", unit = \"m\" }\n\
        y = { column = \"/tracker/position.position_m.y\", unit = \"m\" }\n\
        z = { column = \"/tracker/position.position_m.z\", unit = \"m\" }\n\
        [control]\nphase = { column = \"/control/command.sticks.throttle\", from = [[-1000, \"idle\"], [0.02, \"hold\"]] }\nkeep = \"changes\"\n\
        [command]\nthrottle = { column = \"/control/command.sticks.throttle\", unit = \"1\" }\n";
    fs::write(&map, mcap).unwrap();
    let formats = [
        ("ulog", imported("ulog", &|recording| written(recording, "ulg", &px4))),
        ("dataflash", imported("dataflash", &|recording| written(recording, "bin", &ardupilot))),
        (
            "ros2",
            imported("ros2", &|recording| {
                let file = recording.replace(".mcap", "-bag.mcap");
                fs::write(&file, mavros(&Flight::load(recording).unwrap())).unwrap();
                (file, Vec::new())
            }),
        ),
        (
            "mcap",
            imported("mcap", &|recording| (recording.to_owned(), vec!["--map".to_owned(), map.clone()])),
        ),
    ];
    let parquet = imported("parquet", &|recording| {
        let file = recording.replace("mcap", "parquet");
        bench(["export", recording, "-o", &file]).assert().success();
        (file, vec!["--map".to_owned(), "bench-fraction".to_owned()])
    });
    let own = diagnosed(&flown, &rig);
    let by_format: Vec<(&str, Value)> =
        formats.iter().map(|(format, recordings)| (*format, diagnosed(recordings, &rig))).collect();
    let by_table = diagnosed(&parquet, &rig);
    assert_eq!((&own["verdict"], &own["leading"]), (&"effect".into(), &"battery-discharge".into()));
    let probability = |found: &Value| found["candidates"][0]["probability"].as_f64().unwrap();
    for (format, found) in &by_format {
        // Floats and microseconds changed it by 3e-8 when this was written.
        let apart = (probability(found) - probability(&own)).abs();
        assert!(apart < 1e-6, "{format}: {apart:e}");
    }
    // A table has but the newest frame of each iteration, so its numbers are others.
    for (format, found) in by_format.iter().chain([&("parquet", by_table)]) {
        assert_eq!((&found["verdict"], &found["leading"]), (&own["verdict"], &own["leading"]), "{format}");
    }
}

/// A log of PX4 with a position and, if wanted, a command every 20 ms.
pub fn short(throttle: bool) -> Vec<u8> {
    let mut log = Ulog::new();
    log.format(
        "vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;",
    );
    log.format("vehicle_thrust_setpoint:uint64_t timestamp;float[3] xyz;");
    log.format("cpuload:uint64_t timestamp;float load;");
    log.subscribe(0, 0, "vehicle_local_position");
    log.subscribe(1, 0, "vehicle_thrust_setpoint");
    log.subscribe(2, 0, "cpuload");
    for k in 0..100 {
        let time = BOOT_US + k * 20_000;
        let position = floats(&[1.0, 2.0, -0.01 * k as f64]);
        log.data(0, time, &[&(time - 4000).to_le_bytes()[..], &position].concat());
        if throttle {
            log.data(1, time + 1000, &floats(&[0.0, 0.0, -0.5]));
        }
        log.data(2, time + 2000, &floats(&[0.3]));
    }
    log.bytes()
}

/// A log of `ArduPilot` with a position and a command every 20 ms, by its estimator, whose second core says something else.
pub fn short_dataflash() -> Vec<u8> {
    let mut log = Dataflash::new();
    log.format(80, "XKF1", "QBccCffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,OH");
    log.format(81, "CTUN", "Qff", "TimeUS,ThO,DAlt");
    log.format(82, "BAT", "QBff", "TimeUS,Inst,Volt,Curr");
    for k in 0..100 {
        let time = BOOT_US + k * 20_000;
        for core in [0, 1] {
            let angles = [(500_i16).to_le_bytes(), (-250_i16).to_le_bytes(), 9000_u16.to_le_bytes()].concat();
            let down = if core == 0 { -0.01 * k as f64 } else { 7.0 };
            let values = floats(&[0.5, 0.25, -1.0, 0.0, 1.0, 2.0, down, 0.0]);
            log.data(80, time, &[vec![core], angles, values].concat());
        }
        log.data(81, time, &floats(&[0.5, 1.5]));
        log.data(82, time, &[vec![0], floats(&[4.0, f64::NAN])].concat());
    }
    log.bytes()
}

#[test]
fn a_log_of_ardupilot_finds_its_map_and_its_axes_are_turned() {
    let scratch = Scratch::new();
    let (log, out) = (scratch.name("log.bin"), scratch.name("log.mcap"));
    fs::write(&log, short_dataflash()).unwrap();
    let report = json(&bench(["import", &log, "-o", &out, "--json"]).assert().success());
    assert_eq!(report["map"], "ardupilot");
    // A battery that does not tell its current tells its voltage.
    assert_eq!(
        (&report["used"], &report["rows"], &report["skipped"]),
        (&100.into(), &100.into(), &Value::Array(Vec::new()))
    );
    let flight = Flight::load(&out).unwrap();
    let battery = flight.battery.last().unwrap();
    assert_eq!((flight.battery.len(), battery.voltage_v, battery.current_a), (100, 4.0, None));
    let position = flight.positions.last().unwrap();
    assert!((position.position_m[2] - 0.99).abs() < 1e-7 && position.position_m[1] == -2.0, "{position:?}");
    let motion = flight.motion.last().unwrap();
    assert_eq!(motion.velocity_m_s.map(Option::unwrap), [0.5, -0.25, 1.0]);
    let degrees = motion.attitude_rad.map(|angle| (angle.unwrap().to_degrees() * 1e9).round() / 1e9);
    assert_eq!(degrees, [5.0, 2.5, -90.0]);
    let state = flight.states.last().unwrap();
    assert_eq!((state.phase, state.setpoint_m[2]), (bench_rig::Phase::Hold, 1.5));
}

/// Imports a log that finds its map; gives the report and the flight.
fn imported(scratch: &Scratch, name: &str, log: &[u8]) -> (Value, Flight) {
    let (file, out) = (scratch.name(name), scratch.name("imported.mcap"));
    fs::write(&file, log).unwrap();
    let report = json(&bench(["import", &file, "-o", &out, "--force", "--json"]).assert().success());
    assert_eq!((&report["used"], &report["skipped"]), (&report["rows"], &Value::Array(Vec::new())));
    (report, Flight::load(&out).unwrap())
}

/// A field that is packed as it is.
const fn plain(name: &'static str) -> Packed {
    (name, true, [0, 0], [0, 0])
}

/// A log of main frames 20 ms apart, each with what `values` gives for its number.
fn blackbox(fields: &[&'static str], values: &dyn Fn(i64) -> Vec<i64>) -> Vec<u8> {
    let fields: Vec<Packed> = fields.iter().map(|name| plain(name)).collect();
    let mut log = Blackbox::new(&fields, &["flightModeFlags"], &[]);
    for k in 0..100 {
        log.main(5_000_000 + 20_000 * k, &values(k));
    }
    log.bytes()
}

#[test]
fn logs_of_betaflight_and_inav_find_their_maps() {
    let scratch = Scratch::new();
    let fields = ["setpoint[3]", "baroAlt", "vbatLatest", "amperageLatest"];
    let log = blackbox(&fields, &|k| vec![550, k, 1610, 250]);
    let (report, flight) = imported(&scratch, "betaflight.bbl", &log);
    assert_eq!(report["map"], "betaflight");
    let (position, command) = (flight.positions.last().unwrap(), flight.commands.last().unwrap());
    assert_eq!((position.position_m[2], command.sticks.throttle, flight.commands.len()), (0.99, 0.55, 100));
    let battery = flight.battery.last().unwrap();
    assert_eq!((battery.voltage_v, battery.current_a, flight.battery.len()), (16.1, Some(2.5), 1));
    assert_eq!(flight.states.last().unwrap().phase, bench_rig::Phase::Hold);

    let fields =
        ["rcCommand[3]", "navPos[0]", "navPos[1]", "navPos[2]", "navVel[2]", "navTgtPos[2]", "BaroAlt"];
    let log = blackbox(&fields, &|k| vec![1400, 100, 200, k, 50, 150, 7]);
    let (report, flight) = imported(&scratch, "inav.TXT", &log);
    assert_eq!(report["map"], "inav");
    let position = flight.positions.last().unwrap();
    assert_eq!(position.position_m, [1.0, -2.0, 0.99]);
    assert!((flight.commands.last().unwrap().sticks.throttle - 0.4).abs() < 1e-12);
    assert_eq!(flight.states.last().unwrap().setpoint_m[2], 1.5);

    // Without a barometer: what is missing, and what can still be done.
    let log = scratch.name("racer.bbl");
    fs::write(&log, blackbox(&["setpoint[3]", "vbatLatest"], &|_| vec![550, 1610])).unwrap();
    let words = refused(bench(["import", &log, "-o", &scratch.name("racer.mcap")]), 2);
    for part in [
        "no altitude",
        "main.baroAlt",
        "main.navPos[2]",
        "needs a barometer",
        "motion capture",
        "setpoint[3]",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    // Two flights in one file: the first is taken, and the other is told.
    let fields = ["setpoint[3]", "baroAlt"];
    let [first, second] = [0, 1000].map(|begin| blackbox(&fields, &|k| vec![550, begin + k]));
    let log = scratch.name("two.bbl");
    fs::write(&log, [first, second].concat()).unwrap();
    let out = scratch.name("two.mcap");
    let words = stdout(&bench(["import", &log, "-o", &out, "--explain"]).assert().success());
    assert!(words.contains("1 more in the file") && words.contains("main[1] (100 samples)"), "{words}");
    assert_eq!(Flight::load(&out).unwrap().positions.len(), 100);
}

#[test]
fn a_crazyflie_says_the_same_by_its_card_and_by_its_client() {
    let scratch = Scratch::new();
    let variables = [
        ("stateEstimate.x", 'f'),
        ("stateEstimate.y", 'f'),
        ("stateEstimate.z", 'f'),
        ("stateEstimate.pitch", 'f'),
        ("stabilizer.thrust", 'f'),
        ("pm.vbat", 'f'),
    ];
    let values = |k: u32| [0.5, -0.25, 0.0625 * f64::from(k), 4.0, 36_000.0, 3.75];
    let mut card = Crazyflie::new(2, &[("fixedFrequency", &variables), ("lost", &[("id", 'B')])]);
    let names: Vec<&str> = variables.iter().map(|(name, _)| *name).collect();
    let mut client = format!("Timestamp,{}\n", names.join(","));
    for k in 0..60 {
        card.data(0, 7_000_000 + u64::from(k) * 10_000, &floats(&values(k)));
        let cells = values(k).map(|value| value.to_string());
        client += &[&(7_000 + 10 * k).to_string(), ",", &cells.join(","), "\n"].concat();
    }
    let (by_card, flight) = imported(&scratch, "log00", &card.bytes());
    assert_eq!(by_card["map"], "crazyflie");
    let (position, motion) = (flight.positions.last().unwrap(), flight.motion.last().unwrap());
    assert_eq!(position.position_m, [0.5, -0.25, 3.6875]);
    // The firmware's pitch is positive with the nose up.
    assert!((motion.attitude_rad[1].unwrap().to_degrees() + 4.0).abs() < 1e-9, "{motion:?}");
    assert_eq!(
        (flight.commands.last().unwrap().sticks.throttle, flight.battery[0].voltage_v),
        (36_000.0, 3.75)
    );
    let (by_client, again) = imported(&scratch, "block-20260101T12-00-00.csv", client.as_bytes());
    assert_eq!(by_client["map"], "crazyflie");
    assert_eq!(
        (flight.positions, flight.commands, flight.battery),
        (again.positions, again.commands, again.battery)
    );
    // A rig is drafted from either.
    let draft = scratch.name("draft.toml");
    bench(["rig", "from-log", &scratch.name("log00"), "-o", &draft]).assert().success();
    bench(["check", &draft]).assert().success();
    // A block without the altitude.
    let log = scratch.name("battery.csv");
    fs::write(&log, "Timestamp,pm.vbat,stabilizer.thrust\n1,3.9,0\n").unwrap();
    let words = refused(bench(["import", &log, "-o", &scratch.name("battery.mcap")]), 2);
    assert!(words.contains("no altitude") && words.contains("in one block"), "{words}");
}

#[test]
fn a_log_finds_its_map_and_says_what_it_used() {
    let scratch = Scratch::new();
    let (log, out) = (scratch.name("log.ulg"), scratch.name("log.mcap"));
    fs::write(&log, short(true)).unwrap();
    let words = stdout(&bench(["import", &log, "-o", &out, "--explain"]).assert().success());
    for part in [
        "map px4:",
        "vehicle_local_position.z",
        "vehicle_attitude.q.roll",
        "cpuload (100 samples)",
        "command.throttle: 0.5000 to 0.5000",
    ] {
        assert!(words.contains(part), "{part}: {words}");
    }
    let flight = Flight::load(&out).unwrap();
    let last = flight.positions.last().unwrap();
    // A float of 0.99 is right to 6e-8 of itself.
    assert!((last.position_m[2] - 0.99).abs() < 1e-7 && last.position_m[1] == -2.0, "{last:?}");
    assert_eq!(last.arrived_at.nanos() - last.exposed_at.nanos(), 4_000_000);
}

#[test]
fn a_log_that_lacks_something_says_what_and_what_can_still_be_done() {
    let scratch = Scratch::new();
    let out = scratch.name("log.mcap");
    let write = |name: &str, bytes: &[u8]| {
        fs::write(scratch.path(name), bytes).unwrap();
        scratch.name(name)
    };
    // Cut, as by a crash.
    let whole = short(true);
    let cut = write("cut.ulg", &whole[..whole.len() - 700]);
    let words = stdout(&bench(["import", &cut, "-o", &out]).assert().success());
    assert!(words.contains("ends in the middle of a message"), "{words}");
    // A stamp from nowhere, and samples that stand in the file after later ones.
    let mut log = Ulog::new();
    log.format("vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;float z;");
    log.format("vehicle_thrust_setpoint:uint64_t timestamp;float[3] xyz;");
    log.subscribe(0, 0, "vehicle_local_position");
    log.subscribe(1, 0, "vehicle_thrust_setpoint");
    for k in [0, 2, 1, 3, 90_000, 4] {
        let time = BOOT_US + k * 10_000;
        log.data(0, time, &[&time.to_le_bytes()[..], &floats(&[-0.1 * k as f64])].concat());
        log.data(1, BOOT_US + k.min(5) * 10_000, &floats(&[0.0, 0.0, if k == 3 { f64::NAN } else { -0.5 }]));
    }
    let wild = write("wild.ulg", &log.bytes());
    let report = json(&bench(["import", &wild, "-o", &out, "--force", "--json"]).assert().success());
    assert_eq!(
        (&report["topics"]["wild_stamps"], &report["skipped"]),
        (&1.into(), &Value::Array(Vec::new()))
    );
    let flight = Flight::load(&out).unwrap();
    let arrived: Vec<u64> =
        flight.positions.iter().map(|position| position.arrived_at.nanos() / 1_000_000).collect();
    let commanded: Vec<u64> =
        flight.commands.iter().map(|command| command.time.nanos() / 1_000_000).collect();
    assert_eq!((arrived, commanded), (vec![0, 10, 20, 30, 40], vec![0, 10, 20, 40, 50]));
    // No throttle.
    let idle = write("idle.ulg", &short(false));
    let words = stdout(&bench(["import", &idle, "-o", &out, "--force"]).assert().success());
    assert!(words.contains("no throttle in the log") && words.contains("map px4:"), "{words}");
    fs::remove_file(&out).unwrap();
    // No altitude.
    let mut log = Ulog::new();
    log.format("cpuload:uint64_t timestamp;float load;");
    log.subscribe(0, 0, "cpuload");
    log.data(0, 1, &floats(&[0.5]));
    let blind = write("blind.ulg", &log.bytes());
    let words = refused(bench(["import", &blind, "-o", &out]), 2);
    assert!(words.contains("no altitude") && words.contains("cpuload"), "{words}");
    // Nothing but a beginning, and a map for something else.
    for head in [&b"ULog\x01\x12\x35\x01 and more"[..], b"\xa3\x95\x80\x80\x59"] {
        let beginning = write("head.log", head);
        refused(bench(["import", &beginning, "-o", &out]), 2);
    }
    let words = refused(bench(["import", "--map", "ardupilot", &cut, "-o", &out]), 2);
    assert!(words.contains("a PX4 log (ULog)") && words.contains("ArduPilot"), "{words}");
    let words = refused(bench(["import", "--map", "crazypad", &cut, "-o", &out]), 2);
    assert!(words.contains("a PX4 log (ULog)") && words.contains("leave out --map"), "{words}");
    let table = write("table.parquet", b"PAR1\x15\x04");
    let words = refused(bench(["import", "--map", "crazypad", &table, "-o", &out]), 2);
    assert!(words.contains("a Parquet table") && words.contains("cut"), "{words}");
    assert!(!scratch.path("log.mcap").exists());
}

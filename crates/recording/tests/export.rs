//! Tables hold what was recorded.

mod common;

use std::{fs, path::Path};

use bench_device::{PositionSample, Time, TrackStatus};
use bench_recording::{Battery, Channel, ExportOptions, Mode, Record, RecordingError, Session, export};
use common::{flight, session, write};
use parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::Field,
};
use tempfile::tempdir;

const FLIGHT: ExportOptions = ExportOptions { channel: None };

fn channel(name: &str) -> ExportOptions {
    ExportOptions { channel: Some(name.to_owned()) }
}

/// Heading and rows.
fn read_csv(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let owned = |row: &csv::StringRecord| row.iter().map(str::to_owned).collect::<Vec<_>>();
    let heading = owned(reader.headers().unwrap());
    (heading, reader.records().map(|row| owned(&row.unwrap())).collect())
}

#[test]
fn the_flight_has_a_row_for_each_tick() {
    let folder = tempdir().unwrap();
    let mut records = flight(2.0);
    // A lost marker is not the latest position.
    records.push(
        PositionSample {
            arrived_at: Time::from_seconds(1.90001),
            status: TrackStatus::Lost,
            ..PositionSample::default()
        }
        .into(),
    );
    let (input, _) = write(folder.path(), "flight.mcap", &session(), &records);
    let output = folder.path().join("flight.csv");
    let exported = export(&input, &output, &FLIGHT).unwrap();
    assert_eq!(exported.tables, [("flight".to_owned(), 20)]);
    let (heading, rows) = read_csv(&output);
    assert_eq!(rows.len(), 20);
    let row = &rows[19];
    let cell = |name: &str| {
        let column = heading.iter().position(|heading| heading == name);
        row[column.unwrap_or_else(|| panic!("no column {name} in {heading:?}"))].as_str()
    };
    assert_eq!(cell("time_s"), "1.900000000");
    assert_eq!(cell("phase"), "hold");
    assert_eq!(cell("estimate_z_m"), "0.39");
    assert_eq!(cell("setpoint_z_m"), "0.4");
    assert_eq!(cell("overrun"), "true");
    // Positions come each 0.04 s: the last one at hand at 1.9 s came at 1.88 s, exposed 0.3 s before.
    assert_eq!(cell("exposed_at_s"), "1.580000000");
    assert_eq!(cell("position_z_m").parse(), Ok(0.4 + 94.0 * 0.02));
    assert_eq!(cell("truth_z_m").parse(), Ok(0.41 + 95.0 * 0.02));
    assert_eq!(cell("lateness_s").parse(), Ok(Time::from_nanos(50_000).seconds()));
}

#[test]
fn commands_belong_to_the_iteration_that_gave_them() {
    let folder = tempdir().unwrap();
    let records: Vec<_> = flight(1.0)
        .into_iter()
        .map(|record| match record {
            // Given 2 ms into the iteration.
            Record::Command(mut command) => {
                command.time = command.time.shifted(0.002);
                command.into()
            }
            other => other,
        })
        .collect();
    let (input, _) = write(folder.path(), "flight.mcap", &session(), &records);
    let output = folder.path().join("flight.csv");
    export(&input, &output, &FLIGHT).unwrap();
    let (heading, rows) = read_csv(&output);
    // The session's rig is no complete rig, so the sticks' unit is not known.
    let column = heading.iter().position(|name| name == "command_throttle_actuation").unwrap();
    for (row, step) in rows.iter().zip((0..50).step_by(5)) {
        assert_eq!(row[column].parse(), Ok(1.9 + f64::from(step) * 0.02), "{row:?}");
    }
}

#[test]
fn a_channel_is_exported_as_recorded() {
    let folder = tempdir().unwrap();
    let (input, _) = write(folder.path(), "flight.mcap", &session(), &flight(3.0));
    let output = folder.path().join("rotor.csv");
    export(&input, &output, &channel("/rotor")).unwrap();
    let text = fs::read_to_string(&output).unwrap();
    assert_eq!(
        text,
        "time_s,speed_1_rad_s,speed_2_rad_s,speed_3_rad_s,speed_4_rad_s\n\
         0.000000000,900,901,,903\n\
         1.000000000,901,901,,903\n\
         2.000000000,902,901,,903\n"
    );
}

#[test]
fn parquet_holds_the_same_values() {
    let folder = tempdir().unwrap();
    let (input, _) = write(folder.path(), "flight.mcap", &session(), &flight(3.0));
    let output = folder.path().join("rotor.parquet");
    export(&input, &output, &channel("/rotor")).unwrap();
    let reader = SerializedFileReader::try_from(output.as_path()).unwrap();
    let rows: Vec<Vec<Field>> = reader
        .get_row_iter(None)
        .unwrap()
        .map(|row| row.unwrap().get_column_iter().map(|(_, field)| field.clone()).collect())
        .collect();
    let double = Field::Double;
    assert_eq!(rows[2], [double(2.0), double(902.0), double(901.0), Field::Null, double(903.0)]);

    let output = folder.path().join("flight.parquet");
    export(&input, &output, &FLIGHT).unwrap();
    let reader = SerializedFileReader::try_from(output.as_path()).unwrap();
    let row = reader.get_row_iter(None).unwrap().nth(5).unwrap().unwrap();
    let cell = |name: &str| row.get_column_iter().find(|(column, _)| *column == name).unwrap().1;
    assert_eq!(cell("phase"), &Field::Str("hold".into()));
    assert_eq!(cell("overrun"), &Field::Bool(false));
}

#[test]
fn a_workbook_has_the_flight_every_channel_and_the_session_and_repeats_to_the_byte() {
    let folder = tempdir().unwrap();
    let (input, _) = write(folder.path(), "flight.mcap", &session(), &flight(3.0));
    let books = ["a.xlsx", "b.xlsx"].map(|name| folder.path().join(name));
    let exported = books.each_ref().map(|book| export(&input, book, &FLIGHT).unwrap());
    let names: Vec<_> = exported[0].tables.iter().map(|(name, rows)| (name.as_str(), *rows)).collect();
    assert_eq!(names[0], ("flight", 30));
    assert!(names.contains(&("/plant/truth", 150)), "{names:?}");
    assert!(fs::read(&books[0]).unwrap() == fs::read(&books[1]).unwrap());
}

#[test]
fn what_cannot_be_exported_is_told_and_leaves_no_file() {
    let folder = tempdir().unwrap();
    let (input, _) = write(folder.path(), "flight.mcap", &session(), &flight(1.0));
    let to =
        |name: &str, options: &ExportOptions| export(&input, folder.path().join(name), options).unwrap_err();
    assert!(matches!(to("x.ods", &FLIGHT), RecordingError::UnknownTable { .. }));
    assert!(matches!(to("x", &FLIGHT), RecordingError::UnknownTable { .. }));
    let error = to("x.csv", &channel("/imu"));
    assert!(error.to_string().contains("/plant/truth"), "{error}");
    assert!(matches!(to("x.csv", &channel("/airframe/motion")), RecordingError::NoMessages { .. }));

    let import = Session::new(Mode::Import);
    let positions: Vec<_> =
        flight(1.0).into_iter().step_by(7).filter(|r| r.channel() != Channel::Tick).collect();
    let (input, _) = write(folder.path(), "import.mcap", &import, &positions);
    let error = export(&input, folder.path().join("x.csv"), &FLIGHT).unwrap_err();
    assert!(matches!(error, RecordingError::NoMessages { .. }), "{error}");
    let names: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
}

#[test]
fn a_sheet_with_too_many_rows_is_refused_before_it_is_written() {
    let folder = tempdir().unwrap();
    let battery = |i: u32| {
        Battery { time: Time::from_nanos(u64::from(i) * 1_000_000), voltage_v: 3.7, current_a: None }.into()
    };
    let records: Vec<_> = (0..1_048_576).map(battery).collect();
    let (input, _) = write(folder.path(), "long.mcap", &session(), &records);
    let error = export(&input, folder.path().join("x.xlsx"), &channel("/battery")).unwrap_err();
    assert!(matches!(error, RecordingError::TooManyRows { rows: 1_048_576, .. }), "{error}");
    assert!(error.to_string().contains("parquet"), "{error}");
}
